"""The robot and the water, stated once, in straight-line Python for any scalar backend.

``dynamics`` is a time step, ``hydrodynamics`` the drag law, ``reactive`` and ``added_mass`` the
optional water that moves along; ``kinematics``, ``attitude``, ``robot`` and ``layout`` say what a
state, an attitude, a body and a row of numbers are; ``arithmetic`` is what all compute with, and
``simd`` and ``compiling`` compile it.
"""
