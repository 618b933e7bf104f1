"""The robot and the water, stated once, in straight-line Python for any scalar backend.

``dynamics`` is a time step, ``hydrodynamics`` the drag law, ``reactive`` and ``added_mass`` the
optional added mass. ``kinematics``, ``attitude``, ``robot`` and ``layout`` define the state, the
attitude, the body and the tables of numbers. ``arithmetic`` holds the operations; ``simd`` and
``compiling`` compile them, ``symbols`` and ``printing`` print them in other languages.
"""
