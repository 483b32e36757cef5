"""Published recordings converted to the CSV and TOML of the contract."""

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
    """Convert the Xsens recording of imu_tk: unsigned counts about 32768, no table, no stages."""
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
    """Return the authors' solution in the model of the contract: M and b of accelerometers and gyros.

    They give a = T K (raw − b) with an upper triangular T for the accelerometers; the contract's body frame is the one
    in which it is lower triangular, which the authors' numbers give too. The gyro's result is rotated by
    the difference of the two frames.
    """
    upper = np.array([[1.0, -0.0033593, -0.00890639], [0.0, 1.0, -0.0213341], [0.0, 0.0, 1.0]])
    upper = upper @ np.diag([2.41278e-3, 2.42712e-3, 2.41168e-3])
    lower = np.array([[1.0, 0.0, 0.0], [-0.00354989, 1.0, 0.0], [-0.00890444, -0.0213032, 1.0]])
    lower = lower @ np.diag([2.41267e-3, 2.42659e-3, 2.41232e-3])
    turn = lower @ np.linalg.inv(upper)
    gyro = np.array([[1.0, 0.00593634, 0.00111101], [0.00808812, 1.0, -0.0535569], [0.0253067, -0.0025513, 1.0]])
    gyro = turn @ gyro @ np.diag(1.0 / np.array([4777.96, 4764.21, 4773.66]))
    return {
        "turn": turn,
        "accel_matrix": IMU_TK_ACCEL_LSB * np.linalg.inv(lower),
        "accel_bias": IMU_TK_ACCEL_LSB * (np.array([33124.2, 33275.2, 32364.4]) - 32768),
        "gyro_matrix": IMU_TK_GYRO_LSB * np.linalg.inv(gyro),
        "gyro_bias": IMU_TK_GYRO_LSB * (np.array([32777.1, 32459.8, 32511.8]) - 32768),
    }


IMU_ARRAY_META = """
[site] # Stockholm
latitude_deg = 59.35
longitude_deg = 18.07
height_m = 30.0
gravity_mps2 = 9.818

[imu]
serial = "IMU 1"
sample_rate_hz = 62.5
output = "rate"
gyro_lsb = 1.0642251e-3 # 1/16.4 °/s
accel_lsb = 4.79378e-3 # 9.818/2048 m/s²
gyro_arw = 4e-4 # measured at rest
accel_vrw = 4.5e-3

[imu2]
serial = "IMU {0}"
sample_rate_hz = 62.5
output = "rate"
gyro_lsb = 1.0642251e-3
accel_lsb = 4.79378e-3
gyro_arw = 4e-4
accel_vrw = 4.5e-3
"""


def imu_array(folder: Path, secondary: int) -> Path:
    """Convert IMU 1 of the array as primary and another as secondary; saturated rows are invalid."""
    raw = np.frombuffer((IMU_ARRAY / "exp_1.bin").read_bytes()[4:], np.uint8)
    packets = raw[: len(raw) // 106 * 106].reshape(-1, 106)
    assert np.all(packets[:, 0] == 0xAA)
    words = packets[:, 8:104].copy().view(">i2").astype(int).reshape(-1, 8, 6)
    ticks = packets[:, 4:8].copy().view(">u4").astype(np.int64)[:, 0]
    time = np.concatenate([[0], np.cumsum(np.diff(ticks) % 2**32)]) / 64e6 + 0.016
    units = [words[:, k] for k in (0, secondary - 1)]
    saturated = (np.abs(np.hstack(units)) >= 32700).any(axis=1)
    if secondary % 2 == 0:  # on the other side of the board: x' = −y, y' = −x, z' = −z
        units[1] = -units[1][:, [1, 0, 2, 4, 3, 5]]
    path = folder / f"imu_array_{secondary}.csv"
    channels = [f"{s}{n}_{a}" for n in ("", "2") for s in ("gyro", "accel") for a in "xyz"]
    columns = np.hstack([unit[:, [3, 4, 5, 0, 1, 2]] for unit in units]).tolist()
    with path.open("w", encoding="utf-8") as stream:
        stream.write(f"seq,time_s,{','.join(channels)},stage,step,valid\n")
        for k, (t, row, spoilt) in enumerate(zip(time, columns, saturated, strict=True)):
            stream.write(f"{k},{t:.6f},{','.join(map(str, row))},cross_calibration,0,{int(not spoilt)}\n")
    path.with_suffix(".toml").write_text(IMU_ARRAY_META.format(secondary), encoding="utf-8")
    return path


#: IMU 3 against IMU 1 from nine recordings of the board: gyro matrix, accelerometer matrix (± 5e-4) and bias, m/s².
ARRAY_3_TO_1 = (
    np.array([[1.00152, 0.00597, 0.00656], [-0.00208, 0.99096, -0.00084], [0.00738, -0.00176, 1.00058]]),
    np.array([[0.99553, 0.00445, -0.00179], [-0.00460, 0.99050, -0.00004], [-0.00157, 0.00173, 0.99709]]),
    np.array([-0.0099, 0.0587, -0.1059]),
)


def array_lever_mm(number: int) -> np.ndarray:
    """Return the lever arm from IMU 1 to another by the drawing of the board, mm."""
    text = (IMU_ARRAY / "imu_positions_m.csv").read_text().splitlines()
    places = np.array([[float(cell) for cell in line.split(",")[1:]] for line in text[1:]])
    return 1e3 * (places[:, number - 1] - places[:, 0])
