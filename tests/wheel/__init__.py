"""What ``.ci/wheel`` runs in a fresh environment, where nothing but the wheel is installed."""
