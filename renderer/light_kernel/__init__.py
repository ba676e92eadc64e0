"""Light tables in one kernel of LLVM."""
