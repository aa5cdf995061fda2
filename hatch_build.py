"""Builds ``vip_factors._kernels`` where there is a C++ compiler; without one the package is pure Python, and slower.

``python hatch_build.py`` builds it into the checkout. ``CXX`` names the compiler, ``CXXFLAGS`` adds options.
"""

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class Kernels(BuildHookInterface):
    """Puts the extension module into wheels, and into the checkout of an editable installation."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build it, if this is a wheel."""
        if self.target_name != "wheel":
            return
        try:
            module = built(Path(self.root))
        except (ImportError, OSError, subprocess.CalledProcessError) as error:
            self.app.display_warning(f"without compiled kernels, which need a C++ compiler: {error}")
            return
        build_data["artifacts"].append(str(module.relative_to(self.root)))
        build_data.update(pure_python=False, infer_tag=True)


def built(root: Path) -> Path:
    """The extension module, built from ``kernels/`` unless it is newer than these."""
    module = root / "vip_factors" / f"_kernels{sysconfig.get_config_var('EXT_SUFFIX')}"
    newest = max(source.stat().st_mtime for source in (root / "kernels").iterdir())
    if module.exists() and module.stat().st_mtime >= newest:
        return module
    import nanobind

    names = [os.environ.get("CXX"), "c++", "g++", "clang++"]
    compiler = next((name for name in names if name and shutil.which(name)), None)
    if compiler is None:
        raise OSError("none found")
    nano = Path(nanobind.include_dir()).parent
    folders = [sysconfig.get_paths()["include"], nano / "include", nano / "ext" / "robin_map" / "include"]
    flags = ["-std=c++17", "-O3", "-DNDEBUG", "-fPIC", "-fvisibility=hidden", "-fno-strict-aliasing", "-shared"]
    if sys.platform == "darwin":
        flags += ["-undefined", "dynamic_lookup"]
    flags += os.environ.get("CXXFLAGS", "").split()
    sources = [root / "kernels" / "module.cpp", nano / "src" / "nb_combined.cpp"]
    includes = [f"-I{folder}" for folder in folders]
    subprocess.run([compiler, *flags, *includes, *map(str, sources), "-o", str(module)], check=True)
    return module


if __name__ == "__main__":
    print(built(Path(__file__).resolve().parent))
