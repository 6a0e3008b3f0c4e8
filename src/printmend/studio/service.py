"""A studio that starts with the computer: what systemd, launchd and the task scheduler of Windows are told.

Each is the user's own: nothing needs an administrator.
"""

import getpass
import plistlib
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import escape

from printmend.errors import InputError
from printmend.files import replacing
from printmend.messages import say

NAME = "printmend-studio"
_LABEL = "org.printmend.studio"
_UNIT = """\
[Unit]
Description=printmend studio

[Service]
ExecStart={command}
Restart=on-failure
RestartSec=5
Nice=5
KillSignal=SIGINT
NoNewPrivileges=yes

[Install]
WantedBy=default.target
"""
# Without these settings a task ends after three days, and does not begin on a battery. [MS-TSCH] 2.5
_TASK = """\
<Task version="1.2" xmlns="http://schemas.microsoft.com/windows/2004/02/mit/task">
  <RegistrationInfo><Description>printmend studio</Description></RegistrationInfo>
  <Triggers><LogonTrigger><UserId>{user}</UserId></LogonTrigger></Triggers>
  <Principals>
    <Principal id="Owner"><UserId>{user}</UserId><LogonType>InteractiveToken</LogonType></Principal>
  </Principals>
  <Settings>
    <DisallowStartIfOnBatteries>false</DisallowStartIfOnBatteries>
    <StopIfGoingOnBatteries>false</StopIfGoingOnBatteries>
    <ExecutionTimeLimit>PT0S</ExecutionTimeLimit>
    <RestartOnFailure><Interval>PT1M</Interval><Count>100</Count></RestartOnFailure>
  </Settings>
  <Actions Context="Owner"><Exec><Command>{program}</Command><Arguments>{words}</Arguments></Exec></Actions>
</Task>
"""


@dataclass(frozen=True)
class Service:
    """A file that describes the service, where it belongs, and the commands that begin and undo it."""

    path: Path
    text: str
    begin: tuple[str, ...]
    undo: tuple[str, ...]


def service(options: Sequence[str], *, platform: str = sys.platform, home: Path | None = None) -> Service:
    """Return what starts ``printmend studio`` with these options. Raises `InputError` for what a file cannot hold."""
    home = home or Path.home()
    command = [sys.executable, "-m", "printmend", "studio", "--no-browser", *options]
    if any(character in word for word in command for character in '\n\r"'):
        raise InputError(say("subject-service"), wanted=say("options-without-quotes-line-ends"), came=say("them"),
                         todo=say("choose-other-names"))  # fmt: skip
    if platform == "darwin":
        path = home / "Library/LaunchAgents" / f"{_LABEL}.plist"
        text = plistlib.dumps({"Label": _LABEL, "ProgramArguments": command, "RunAtLoad": True, "Nice": 5,
                               "KeepAlive": {"SuccessfulExit": False}}).decode()  # fmt: skip
        return Service(path, text, (f"launchctl load -w '{path}'",), (f"launchctl unload -w '{path}'", f"rm '{path}'"))
    if platform == "win32":
        path = home / f"{NAME}.xml"
        given = {"user": getpass.getuser(), "program": command[0], "words": subprocess.list2cmdline(command[1:])}
        text = _TASK.format(**{name: escape(value) for name, value in given.items()})
        text = text.encode("ascii", "xmlcharrefreplace").decode()  # in whatever encoding it is read
        made = (f'schtasks /Create /F /TN {NAME} /XML "{path}"', f"schtasks /Run /TN {NAME}")
        return Service(path, text, made, (f"schtasks /Delete /F /TN {NAME}", f'del "{path}"'))
    path = home / ".config/systemd/user" / f"{NAME}.service"
    quoted = " ".join(f'"{word}"'.replace("%", "%%").replace("$", "$$").replace("\\", "\\\\") for word in command)
    begin = ("systemctl --user daemon-reload", f"systemctl --user enable --now {NAME}", "loginctl enable-linger")
    undo = (f"systemctl --user disable --now {NAME}", f"rm '{path}'")
    return Service(path, _UNIT.format(command=quoted), begin, undo)


def write_service(made: Service) -> None:
    """Write the file that describes a service; nothing is started."""
    made.path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(made.path) as file:
        file.write(made.text)
