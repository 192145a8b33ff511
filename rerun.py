import sys,tempfile; from pathlib import Path
sys.path[:0]=["/tmp/wt-trust/benchmarks/trust"]
from processes import *
import difflib
home=Path(tempfile.mkdtemp())
prepared(home/"a")
for n,(w,o) in COMMANDS.items():
    if n=="demo": continue
    p=started(w,home/"a").wait(); A=contents(home/"a",o); started(w,home/"a").wait(); B=contents(home/"a",o)
    for x,a,b in zip(o,A,B):
        if a!=b:
            at=next(i for i,(u,v) in enumerate(zip(a,b)) if u!=v); print(n,x,len(a),len(b),a[at-60:at+60],b[at-60:at+60])
