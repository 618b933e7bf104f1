"""What moves the robots: two engines for one robot.

``base`` asks any of them for whole trials, ``worlds`` for one robot step by step, ``packages``
says which are here; ``compiled`` and ``bullet`` are the engines themselves.
"""
