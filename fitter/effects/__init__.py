"""Which effects a scene calls for, and what each changes."""
