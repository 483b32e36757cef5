"""IMU drivers, which decode bytes to samples, and the transfer of calibration registers."""

from calstation.devices.imu.drivers import FramedImu, frame_decoder, open_imu
from calstation.devices.imu.frames import FrameDecoder
from calstation.devices.imu.register_transfer import (
    FlashContent,
    JournalEntry,
    TransferOutcome,
    TransferResult,
    TransferStep,
    check_serial,
    finish,
    read_flash_content,
    restart_and_read_registers,
    restore,
    rewrite_old,
    transfer,
)
from calstation.devices.imu.registered_imu import RegisteredImu
from calstation.devices.imu.registers import RegisterMap
from calstation.devices.imu.sample_count import SampleCount
from calstation.devices.imu.streamed_imu import ImuBusyError, ImuRefusalError, StreamedImu
from calstation.devices.imu.text_frames import TextFrame
