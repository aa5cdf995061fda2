"""OpenSense's mapping files (``myIMUMappings.xml``): which sensor is which frame of an OpenSim model."""

from pathlib import Path
from xml.etree import ElementTree

from vip_factors.errors import FileFormatError
from vip_factors.io.importers.site_names import site_of_name


def sites_of_mappings(path: Path) -> dict[str, str]:
    """Sensor name → site, of all experimental sensors whose frame's name tells one: ``_00B42268`` is ``torso_imu``.

    OpenSense begins sensors' names with the ``_`` that ends the trial's in the files' names; it is left out.

    Raises:
        FileFormatError: if the file cannot be read, is no such mapping, or a frame's name tells no site.
    """
    try:
        root = ElementTree.fromstring(path.read_bytes())
    except OSError as error:
        raise FileFormatError(
            f"{path}: cannot be read ({error.strerror}): expected OpenSense's IMU mappings"
        ) from error
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise FileFormatError(f"{path}: {error}: expected OpenSense's IMU mappings (XML)") from error
    found: dict[str, str] = {}
    for sensor in root.iter("ExperimentalSensor"):
        name = (sensor.get("name") or "").strip().lstrip("_")
        frame = (sensor.findtext("name_in_model") or "").strip()
        site = site_of_name(frame)
        if not name or site is None:
            raise FileFormatError(
                f"{path}: sensor '{name}' is frame '{frame}' of the model: expected a name that tells the segment, "
                "such as pelvis_imu, femur_r_imu, torso_imu; or write a placement file (.toml)"
            )
        found[name] = site
    if not found:
        raise FileFormatError(f"{path}: names no ExperimentalSensor: expected OpenSense's IMU mappings")
    return found
