"""What moves the robots: two engines for one robot, and a third with another water.

``base`` asks any of them for whole trials, ``worlds`` for one robot step by step, ``packages``
says which are here; ``compiled``, ``bullet`` and ``mujoco`` are the engines themselves.
"""
