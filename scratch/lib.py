import sys, time
import numpy as np
from pathlib import Path
from calstation.config import RunRequest, resolve_configuration
from calstation.records import context_from_meta, prior_from_meta
from calstation.estimation.navigation.information import *
import calstation.estimation.navigation as nav
from calstation.physics import Move, Dwell, NAMES
import calstation.design.segments as sg
def setup_of(prod, rate, acc):
    setup=resolve_configuration(RunRequest("SN-1", None, Path(f"data/products/{prod}.toml"), ("designed",)))
    meta=setup.log_meta(); ctx=context_from_meta(meta); prior=prior_from_meta(meta); geo=setup.table.geometry()
    mount=np.full(3,.3)*ctx.table.mount_sigma
    lib=sg.SegmentLibrary(ctx,prior,geo,setup.table.settle_s,np.deg2rad(rate),np.deg2rad(acc),mount)
    lim=setup.sigma_limits(); limits=np.array([lim.get(n,np.inf) for n in NAMES])
    return setup,lib,limits
if __name__=="__main__":
    setup,lib,limits=setup_of(sys.argv[1],60,60)
    state=lib.begin((0,0),8.0); pos=(0,0); total=8.0
    t0=time.time()
    for o,i,d in setup.schedules["designed"].moves[1:]:
        to=(round(o/45),round(i/45))
        m,s=lib.move(pos,to); state=advanced(state,m); total+=s; pos=to
        for _ in range(int(d)): state=advanced(state,lib.rest(pos)); total+=1
    r=sigmas(state)/limits
    print(total,time.time()-t0,{NAMES[k]:round(float(r[k]),2) for k in np.argsort(-r)[:8]})
