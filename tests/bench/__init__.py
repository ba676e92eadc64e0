"""Benchmarks: figures for people to read, measured side by side and never asserted. `make bench` runs them all."""
