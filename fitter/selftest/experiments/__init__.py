"""Experiments of the hard cases."""
