"""The papers that kfgen's methods come from, reproduced: each printed number beside what is found here."""
