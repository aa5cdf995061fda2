"""The secret that senders and receiver share. Never an option: everybody on a machine sees the options of programs."""

import os
from pathlib import Path

from vip_factors.errors import InputError

VARIABLE = "VIP_FACTORS_TOKEN"


def read_token(path: Path | None = None) -> str:
    """The token in a file, or else in the environment variable VIP_FACTORS_TOKEN; empty without both.

    Raises:
        InputError: if the file is no text or empty.
        OSError: if it cannot be read.
    """
    if path is None:
        return os.environ.get(VARIABLE, "").strip()
    try:
        token = path.read_text(encoding="utf-8").strip()
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a text file: expected a token") from error
    if not token:
        raise InputError(
            f"{path}: it is empty: expected a token, such as python -c 'import secrets; "
            "print(secrets.token_urlsafe())' makes"
        )
    return token
