"""The numbers of E. M. Hemerly, MEMS IMU stochastic error modelling (2017), each beside what is found here.

Usage: python hemerly_2017.py [SEEDS] [PAGE.html]
Three seeds without arguments, in seconds; from thirty on also figure 3 and all methods against the Cramér-Rao bound.
"""

import sys

from papers.compare import compare, table
from papers.figures import figure_1, figure_2
from papers.hemerly import sections
from papers.row import page_of, text_of

from kfgen.report.page import write_page

seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 3
found = sections(seeds)
for title, rows in found:
    print(text_of(title, rows))
if len(sys.argv) > 2:
    write_page(page_of("Hemerly 2017, again", found, [figure_1(), figure_2()]), sys.argv[2])
if seeds >= 30:
    print(f"All methods at the point of sec. 2.2, {seeds} records of 1e5 samples at 100 Hz")
    print(table(compare(seeds), seeds))
