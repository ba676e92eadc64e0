"""What computes: cores, memory, devices, processes, and interpolation by Chebyshev's polynomials."""
