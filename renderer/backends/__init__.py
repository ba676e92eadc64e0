"""LLVM, Dr.Jit and Mitsuba: chosen and prepared before they enter a process."""
