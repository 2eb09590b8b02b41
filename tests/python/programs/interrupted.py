"""Ctrl-C in the midst of a call: KeyboardInterrupt between its steps, and the process goes on to
reduce."""

import os
import subprocess
import sys
import time

import numpy as np

import flexgram

body = sys.argv[1]
medium = flexgram.certify(body, band_hz=(10, 500), tol=1e-6)
before = medium.reduce(tol=1e-5)
optimal = {"mor_second_stage": "optimal"}
samples = {"mor_samples": 60}
works = {
    "certify": lambda: flexgram.certify(body, band_hz=(10, 800), tol=1e-9),
    "cut": lambda: medium.reduce(order=before.order, options=optimal),
    "pod": lambda: flexgram.reduce(body, band_hz=(10, 500), method="pod", options=samples),
}


def interrupted(work, whole: float) -> str:
    """What ended a call. The interpreter's own handler, which would be looked at only when the
    call is done, says nothing."""
    # From outside: a thread of this process would wait for the interpreter.
    subprocess.Popen(["sh", "-c", f"sleep {0.2 * whole}; kill -INT {os.getpid()}"])
    try:
        work()
        time.sleep(60)
    except KeyboardInterrupt as error:
        return str(error)
    return "nothing"


for name, work in works.items():
    start = time.monotonic()
    work()
    whole = time.monotonic() - start
    # On a busy machine a signal may come when all is done: then once more.
    said = [interrupted(work, whole)]
    while not said[-1] and len(said) < 5:
        said.append(interrupted(work, whole))
    print(name, said[-1])
again = medium.reduce(tol=1e-5)
omega = 2 * np.pi * 123.4
difference = np.abs(again.transfer(omega) - before.transfer(omega)).max()
print("equal", bool(difference <= 1e-9 * np.abs(before.transfer(omega)).max()))
new = flexgram.reduce(body, band_hz=(10, 500), tol=1e-5)
print("order", new.order == before.order, new.kind)
