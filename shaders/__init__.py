"""The shading model: pure functions of tensors; no files, no devices, no globals."""
