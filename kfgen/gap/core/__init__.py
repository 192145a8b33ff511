"""What every gap needs: scenes, fits, screening, tests, hold-out."""
