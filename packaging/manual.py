"""Prints the manual page of a built program: its overview, and the help of each verb.

    python3 packaging/manual.py build/flexgram > flexgram.1
"""

from __future__ import annotations

import re
import subprocess
import sys

HEAD = """.TH FLEXGRAM 1 "" "flexgram {version}" "User Commands"
.SH NAME
flexgram \\- reduces elastic bodies of multibody systems, with a proof of the error
.SH SYNOPSIS
.B flexgram
.I VERB
[\\fIFILE\\fR ...] [\\fIOPTION\\fR ...]
.br
mpirun \\-n
.I N
flexgram
.I VERB
\\&...
.SH DESCRIPTION
"""


def said(*words: str) -> str:
    """What a command prints."""
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    return done.stdout


def verbatim(text: str) -> str:
    """Lines as they are, for troff."""
    lines = text.replace("\\", "\\e").replace("-", "\\-").splitlines()
    return ".nf\n" + "\n".join("\\&" + line for line in lines) + "\n.fi\n"


def main() -> None:
    """The page on standard output."""
    program = sys.argv[1]
    overview = said(program, "--help")
    version = said(program, "--version").split()[1]
    verbs = re.findall(r"^  flexgram (\w+)  ", overview, re.MULTILINE)
    page = HEAD.format(version=version) + verbatim(overview)
    for verb in dict.fromkeys(verbs):
        page += f".SH {verb.upper()}\n" + verbatim(said(program, verb, "--help"))
    print(page, end="")


if __name__ == "__main__":
    main()
