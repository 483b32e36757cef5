import sys, time
import numpy as np
from pathlib import Path
from calstation.config import RunRequest, resolve_configuration
from calstation.records import context_from_meta, prior_from_meta
from calstation.estimation.common import PlannedSamples, stage_data, starts
from calstation.estimation.navigation.filter import NavigationFilter
from calstation.estimation.navigation.information import *
from calstation.sequencer import step_time
from calstation.physics import Move, Dwell, NAMES
prod=sys.argv[1]
setup=resolve_configuration(RunRequest("SN-1", None, Path(f"data/products/{prod}.toml"), ("designed",)))
meta=setup.log_meta(); ctx=context_from_meta(meta); prior=prior_from_meta(meta); geo=setup.table.geometry()
mount=np.full(3,.3)*ctx.table.mount_sigma
plan=[s for s in setup.task().stages[0].steps() if isinstance(s,(Move,Dwell))]
ps=PlannedSamples(ctx, prior.mean, geo, mount)
blocks=[]; j=(0.,0.)
for s in plan:
    sec=step_time(s,j,setup.table.settle_s); blocks+=list(ps.run(s,sec,"designed"))
    if isinstance(s,Move): j=(s.outer,s.inner)
data=stage_data(blocks, ctx.imu)
t=time.time(); found=starts(data,ctx,prior); print("starts",time.time()-t)
for k in range(2):
    run=NavigationFilter(ctx,prior,prior.mean); g=Gatherer()
    t=time.time(); run.run(data,found[0],found[0].attitude,False,g); print("run+gather",time.time()-t)
run2=NavigationFilter(ctx,prior,prior.mean); t=time.time(); run2.run(data,found[0],found[0].attitude,False); print("run",time.time()-t)
t=time.time(); end=advanced(g.start,g.matrix); s=sigmas(end); print("adv",time.time()-t)
print(np.max(np.abs(s/run2.belief.sigma-1)), len(data)*data.dt)
t=time.time()
for _ in range(200): advanced(g.start,g.matrix)
print("advance us",(time.time()-t)/200*1e6)
t=time.time()
for _ in range(200): sigmas(end)
print("sigmas us",(time.time()-t)/200*1e6)
