"""The compiled numerics: build and library. Each binding lies beside its NumPy twin."""
