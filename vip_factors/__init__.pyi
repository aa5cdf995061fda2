__version__: str

from .api import (
    convert as convert,
    detect as detect,
    evaluate as evaluate,
    export as export,
    gait as gait,
    picture as picture,
    read as read,
    repetitions as repetitions,
    report as report,
    serve as serve,
    simulate as simulate,
    stream as stream,
    sync as sync,
    write as write,
)
from .body.joint_angles import joint_angles as joint_angles
from .body.kinematics import Motion as Motion
from .body.skeleton import JOINT_NAMES as JOINT_NAMES
from .detect.settings import DetectSettings as DetectSettings
from .errors import VipFactorsError as VipFactorsError
from .estimate import Estimate as Estimate
from .factor_graph import keys as keys
from .io.convert import ImportOptions as ImportOptions
from .io.live_open import open_source as open_source
from .io.mcap_estimate import read_estimate as read_estimate
from .io.motions.files import read_motion as read_motion
from .io.settings import CameraOptions as CameraOptions, ExportSettings as ExportSettings
from .live.stream import Stream as Stream
from .live.tracker import FixedLagTracker as FixedLagTracker
from .live_estimate import LiveEstimate as LiveEstimate
from .pipeline import factor_graph as factor_graph, smooth as smooth
from .sensors.camera import CameraModel as CameraModel
from .sensors.detections import Detections as Detections
from .sensors.live import ImuSample as ImuSample, VideoFrame as VideoFrame, live_samples as live_samples
from .sensors.recording import Recording as Recording, Subject as Subject
from .sensors.scene import Camera as Camera, Scene as Scene
from .settings import LiveSettings as LiveSettings, Settings as Settings
from .simulate.settings import SceneSettings as SceneSettings, SimulateSettings as SimulateSettings
from .workflow import RunOptions as RunOptions, run as run
