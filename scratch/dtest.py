import time
from pathlib import Path
from calstation.config import RunRequest
from calstation.results.preview import compute_preview
import sys, numpy as np
from calstation.physics import NAMES
for prod in sys.argv[1:]:
    t=time.time()
    p=compute_preview(lambda *a,**k: None, RunRequest("SN-1", None, Path(f"data/products/{prod}.toml"), ("designed",), Path("/tmp/nowhere")))
    s=p.stages[0]
    print(prod, s.reason, s.rounds, round(p.duration,1), s.error, p.violations[:1], round(time.time()-t,2))
    if s.sigma is not None:
        r={n: s.sigma[i]/p.limits[n] for i,n in enumerate(NAMES) if n in p.limits}
        print({n: round(float(v),2) for n,v in sorted(r.items(), key=lambda x:-x[1])[:8]})
