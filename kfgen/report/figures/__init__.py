"""The figures of pages, from results and logs."""
