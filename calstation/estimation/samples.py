"""`SampleBlock`: the one form in which samples travel from driver or file to log and solver."""

from dataclasses import dataclass

from calstation.physics.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class SampleBlock:
    """Consecutive IMU samples of one stage.

    Attributes
    ----------
    stage : name of the stage, "" between stages
    seq : unwrapped sample counter, shape (n,)
    time : IMU clock at the end of each sample, s, shape (n,)
    counts : raw output, gyro x y z then accel x y z, counts, shape (n, 6)
    angles : encoder angles outer, inner at the end of the sample, rad, cumulative, NaN between polls, shape (n, 2)
    step : number of the move the sample belongs to, shape (n,)
    valid : False marks a spoilt sample, shape (n,)
    temperature : °C, NaN where unknown, shape (n,)
    """

    stage: str
    seq: IntArray
    time: FloatArray
    counts: FloatArray
    angles: FloatArray
    step: IntArray
    valid: BoolArray
    temperature: FloatArray

    def __len__(self) -> int:
        return len(self.seq)
