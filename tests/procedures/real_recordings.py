"""Recordings made by others, as the contract's CSV beside its TOML: what a user would write once to solve them here."""

import gzip
from pathlib import Path

import numpy as np

REAL = Path(__file__).parents[3] / "shared" / "data" / "real"
HAND = REAL / "hand_six_position" / "session.csv.gz"
IMU_TK = REAL / "imu_tk_xsens"
IMU_ARRAY = REAL / "imu_array"

IMU_TK_META = """
[site] # Padua; the authors' gravity
latitude_deg = 45.4
longitude_deg = 11.9
height_m = 20.0
gravity_mps2 = 9.81744

[imu]
serial = "Xsens MTi (imu_tk)"
sample_rate_hz = 100.0
output = "rate"
gyro_lsb = 2.094e-4
accel_lsb = 2.415e-3
gyro_arw = 6e-4 # measured over the first 50 s at rest
accel_vrw = 9e-4

[prior] # raw counts of an uncalibrated unit: nothing is near zero
gyro_bias_x = { sigma = 0.2 }
gyro_bias_y = { sigma = 0.2 }
gyro_bias_z = { sigma = 0.2 }
accel_bias_x = { sigma = 3.0 }
accel_bias_y = { sigma = 3.0 }
accel_bias_z = { sigma = 3.0 }
gyro_misalign_xy = { sigma = 0.05 }
gyro_misalign_xz = { sigma = 0.05 }
gyro_misalign_yx = { sigma = 0.05 }
gyro_misalign_yz = { sigma = 0.05 }
gyro_misalign_zx = { sigma = 0.05 }
gyro_misalign_zy = { sigma = 0.05 }
accel_misalign_yx = { sigma = 0.05 }
accel_misalign_zx = { sigma = 0.05 }
accel_misalign_zy = { sigma = 0.05 }
"""

IMU_TK_GYRO_LSB, IMU_TK_ACCEL_LSB = 2.094e-4, 2.415e-3


def imu_tk(folder: Path) -> Path:
    """The Xsens recording of imu_tk: unsigned counts about 32768, no table, no stage."""
    with gzip.open(IMU_TK / "xsens_acc.txt.gz") as a, gzip.open(IMU_TK / "xsens_gyro.txt.gz") as g:
        accel, gyro = np.loadtxt(a), np.loadtxt(g)
    counts = np.column_stack([gyro[:, 1:], accel[:, 1:]]) - 32768
    rows = np.arange(len(counts))
    path = folder / "imu_tk.csv"
    with path.open("w", encoding="utf-8") as stream:
        stream.write("seq,time_s,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z,stage,step\n")
        for k, row in zip(rows, counts.astype(int).tolist(), strict=True):
            stream.write(f"{k},{(k + 1) / 100:.2f},{','.join(map(str, row))},,0\n")
    (folder / "imu_tk.toml").write_text(IMU_TK_META, encoding="utf-8")
    return path


def imu_tk_published() -> dict[str, np.ndarray]:
    """The authors' answer in the contract's model: M and b of accelerometers and gyros.

    They give a = T K (raw − b) with an upper triangular T for the accelerometers; the contract's body frame is the one
    in which it is lower triangular, which the authors' numbers give too. The rotation between the two turns the gyro's
    answer.
    """
    upper = np.array([[1.0, -0.0033593, -0.00890639], [0.0, 1.0, -0.0213341], [0.0, 0.0, 1.0]])
    upper = upper @ np.diag([2.41278e-3, 2.42712e-3, 2.41168e-3])
    lower = np.array([[1.0, 0.0, 0.0], [-0.00354989, 1.0, 0.0], [-0.00890444, -0.0213032, 1.0]])
    lower = lower @ np.diag([2.41267e-3, 2.42659e-3, 2.41232e-3])
    turn = lower @ np.linalg.inv(upper)
    gyro = np.array(
        [[1.0, 0.00593634, 0.00111101], [0.00808812, 1.0, -0.0535569], [0.0253067, -0.0025513, 1.0]]
    )
    gyro = turn @ gyro @ np.diag(1.0 / np.array([4777.96, 4764.21, 4773.66]))
    return {
        "turn": turn,
        "accel_matrix": IMU_TK_ACCEL_LSB * np.linalg.inv(lower),
        "accel_bias": IMU_TK_ACCEL_LSB * (np.array([33124.2, 33275.2, 32364.4]) - 32768),
        "gyro_matrix": IMU_TK_GYRO_LSB * np.linalg.inv(gyro),
        "gyro_bias": IMU_TK_GYRO_LSB * (np.array([32777.1, 32459.8, 32511.8]) - 32768),
    }
