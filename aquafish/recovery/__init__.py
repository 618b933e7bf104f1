"""The paper's case study, from damage to recovery (Sec. 5).

``treatment`` does the work, ``report`` counts it, ``figures`` draws it, and ``command`` joins them.
"""
