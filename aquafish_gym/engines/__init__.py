"""The engines that move the robots: one robot in one water, computed in two ways.

``base`` simulates whole trials on either, ``worlds`` one robot step by step, ``packages`` knows
which are installed; ``compiled`` and ``bullet`` are the engines themselves.
"""
