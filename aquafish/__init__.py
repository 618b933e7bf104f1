"""The paper's case study, which joins the self-models of ``eea`` and the gaits of ``gait``.

The ``aquafish`` command leads to this and to every command of both. No other package imports
this one, and no other imports both of those.
"""
