import sys, time
sys.path.insert(0,'/tmp')
import numpy as np
from lib import setup_of
from calstation.estimation.navigation.information import *
from calstation.physics import NAMES, COUNT
prod, rate, acc, margin, tmax, width = sys.argv[1], *map(float, sys.argv[2:7])
power=float(sys.argv[7]) if len(sys.argv)>7 else 1.0
width=int(width)
setup,lib,limits=setup_of(prod, rate, acc)
fin=np.isfinite(limits)
lo,hi=[int(np.rad2deg(v)//45) for v in setup.table.geometry().limits.low],[int(np.rad2deg(v)//45) for v in setup.table.geometry().limits.high]
def adv_many(states, segs):
    m=(segs.shape[-1]-COUNT)//2
    total=segs.copy()
    at=np.r_[0:m,2*m:2*m+COUNT]
    total[np.ix_(np.arange(len(segs)),at,at)]+=states
    cross=total[:,m:,:m]
    return total[:,m:,m:]-cross@np.linalg.solve(total[:,:m,:m],cross.transpose(0,2,1))
def sig_many(states):
    d=1/np.sqrt(np.diagonal(states,axis1=1,axis2=2))
    inv=np.linalg.inv(states*d[:,:,None]*d[:,None,:])
    return np.sqrt(np.diagonal(inv,axis1=1,axis2=2)[:,-COUNT:])*d[:,-COUNT:]
def pot(s):
    r=np.log(np.maximum(s[:,fin]/(limits[fin]*margin),1.0))
    return (r**power).sum(1)
rest_after=float(1)
deltas=[(a,b) for a in (-8,-4,-2,0,2,4,8) for b in (-8,-4,-2,0,2,4,8) if (a or b) and abs(a)+abs(b)<=10]
cache={}
def movrest(at,to):
    key=(at[0]%8,at[1]%8,to[0]-at[0],to[1]-at[1])
    if key not in cache:
        m,s=lib.move(at,to); cache[key]=(joined(m,lib.rest(to)),s+1.0)
    return cache[key]
restc={}
def rest(pos,n_):
    key=(pos[0]%8,pos[1]%8,n_)
    if key not in restc:
        m=lib.rest(pos)
        r=m
        for _ in range(n_-1): r=joined(r,m)
        restc[key]=r
    return restc[key]
t0=time.time()
first=6.0
s0=lib.begin((0,0),first)
B=1.0  # bucket s
buckets={int(first/B):[(0.0,s0,(0,0),[(0,0,first)],first)]}
best=None; n=0
for b in range(int(first/B), int(tmax/B)+1):
    items=buckets.pop(b,[])
    if not items: continue
    items.sort(key=lambda x:x[0])
    kept=[]; seen=set()
    for it in items:
        k=(it[2][0]%8,it[2][1]%8,round(it[0],3))
        if k in seen: continue
        seen.add(k); kept.append(it)
        if len(kept)>=width: break
    if kept[0][0]<=0 and b>first:
        best=kept[0]; break
    S,G,meta=[],[],[]
    for p,st,pos,path,t in kept:
        for d in deltas:
            to=(pos[0]+d[0],pos[1]+d[1])
            if not all(l<=x<=h for l,x,h in zip(lo,to,hi)): continue
            seg,dur=movrest(pos,to)
            if t+dur>tmax: continue
            S.append(st);G.append(seg);meta.append((to,path+[(to[0]*45,to[1]*45,1.0)],t+dur))
        if len(path)>1:
            o,i,dw=path[-1]
            for n_ in (1,3,8,20):
                if t+n_<=tmax:
                    S.append(st);G.append(rest(pos,n_));meta.append((pos,path[:-1]+[(o,i,dw+n_)],t+n_))
    if not S: continue
    new=adv_many(np.array(S),np.array(G)); n+=len(new)
    pp=pot(sig_many(new))
    for k,(to,path,t) in enumerate(meta):
        buckets.setdefault(int(np.ceil(t/B)),[]).append((pp[k],new[k],to,path,t))
    for key in list(buckets):
        if len(buckets[key])>8*width:
            buckets[key].sort(key=lambda x:x[0]); buckets[key]=buckets[key][:4*width]
print("time",round(time.time()-t0,1),"evals",n)
if best is None:
    last=min((it for v in buckets.values() for it in v),key=lambda x:x[0],default=None) or kept[0]
    print("not reached",last[0], last[4]); best=last
r=sig_many(best[1][None])[0]/limits
print("T",best[4],"moves",len(best[3])-1,"worst",round(float(r[fin].max()),3),NAMES[int(np.argmax(np.where(fin,r,0)))]); print(best[3])
