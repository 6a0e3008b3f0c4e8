# SPDX-License-Identifier: AGPL-3.0-or-later
"""Cura post-processing script: mends the sliced file before it is saved or sent.

Cura saves a file whose script failed as if nothing had happened. So a file that cannot be mended is replaced by a
comment that says why, unless the owner chose to print it as it was sliced.
"""

import json
import os
import re
import subprocess
import tempfile

from ..Script import Script

try:
    from UM.Logger import Logger
    from UM.Message import Message
except ImportError:  # outside Cura
    Logger = Message = None

SETTINGS = {
    "name": "Mend for my printer (printmend)",
    "key": "Printmend",
    "metadata": {},
    "version": 2,
    "settings": {
        "command": {
            "label": "printmend",
            "description": "The program that mends, for example /home/me/printmend/bin/printmend",
            "type": "str",
            "default_value": "printmend",
        },
        "model": {
            "label": "Model",
            "description": "What `printmend learn` wrote about this printer: printer.mend.json",
            "type": "str",
            "default_value": "",
        },
        "or_print": {
            "label": "Print unmended files",
            "description": "A file that cannot be mended is saved as it was sliced, not as an empty one",
            "type": "bool",
            "default_value": False,
        },
    },
}
LAYER = re.compile(r"^;LAYER:", re.MULTILINE)


class Printmend(Script):
    def getSettingDataString(self):
        return json.dumps(SETTINGS)

    def execute(self, data):
        """Return Cura's list of layers, mended."""
        command, model = self.getSettingValueByKey("command"), self.getSettingValueByKey("model")
        text, reason = mend("".join(data), command, model)
        if reason:
            self._say(reason)
            already = "one that was mended with model" in reason
            return (
                data if already or self.getSettingValueByKey("or_print") else [f"; not mended by printmend: {reason}\n"]
            )
        starts = [0, *(found.start() for found in LAYER.finditer(text)), len(text)]
        return [text[starts[i] : starts[i + 1]] for i in range(len(starts) - 1)]

    def _say(self, reason):
        if Logger is not None:
            Logger.log("e", "printmend: %s", reason)
        if Message is not None:
            Message(f"printmend: {reason}", title="The file was not mended").show()


def mend(text, command, model):
    """Return the mended text and no reason, or the reason."""
    environment = {k: v for k, v in os.environ.items() if k not in ("LD_LIBRARY_PATH", "PYTHONHOME", "PYTHONPATH")}
    with tempfile.TemporaryDirectory() as folder:
        source, fresh = os.path.join(folder, "cura.gcode"), os.path.join(folder, "mended.gcode")
        with open(source, "w", encoding="utf-8", newline="") as file:
            file.write(text)
        try:
            done = subprocess.run(  # noqa: S603 — the owner's own program, from Cura's settings
                [command, "mend", source, "-m", model, "-o", fresh],
                env=environment, capture_output=True, text=True, errors="replace", check=False,
                stdin=subprocess.DEVNULL,
            )  # fmt: skip
        except OSError as error:
            return "", f"{command}: {error.strerror or error}"
        if done.returncode != 0:
            lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
            return "", lines[-1].removeprefix("printmend: ") if lines else f"printmend ended with {done.returncode}"
        with open(fresh, encoding="utf-8", newline="") as file:
            return file.read(), ""
