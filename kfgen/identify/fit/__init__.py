"""Maximum likelihood, the choice among effects, intervals and limits."""
