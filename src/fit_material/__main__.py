"""`python -m fit_material` is `fit-material`."""

from fit_material.fitter.__main__ import program

if __name__ == "__main__":
    program()
