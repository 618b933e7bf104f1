"""The compiled engine: thousands of robots at once in vector registers, or one by itself.

Its modules load numba, which is why ``engines.base`` and ``engines.worlds`` import them only when
this engine is asked for.
"""
