"""The paper's case study, from damage to recovery (Sec. 5).

``treatment`` runs one treatment, ``report`` counts, ``figures`` draws, ``command`` joins them.
"""
