"""`kfgen open`: a page on this machine that takes logs, runs the commands on them, and hands back what they wrote."""
