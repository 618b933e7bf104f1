"""The compiled engine: thousands of robots at once in vector registers, or one by itself.

Its modules load numba, so they are imported only when this engine is used.
"""
