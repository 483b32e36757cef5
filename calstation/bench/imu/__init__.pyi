from .flash import burnt_cycles as burnt_cycles
from .modbus_dsp import DspUnit as DspUnit
from .stream_faults import StreamFaults as StreamFaults
from .unit import ImuUnit as ImuUnit
from .vectornav import SAMPLES as SAMPLES
from .vectornav import VectorNavUnit as VectorNavUnit
