"""What a material is: its quantities as data, and the types as tensors."""
