"""Other projects' own tests on AquaFish: ``pytest -m slow tests/peers``."""
