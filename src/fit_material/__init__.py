"""What an object is made of, from photographs of it. See `docs/architecture.md` for what lies where."""
