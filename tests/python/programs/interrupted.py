"""Ctrl-C in the midst of a reduction: KeyboardInterrupt, and the process goes on to reduce."""

import os
import subprocess
import sys

import numpy as np

import flexgram

body, seconds = sys.argv[1], [float(word) for word in sys.argv[2:]]
medium = flexgram.certify(body, band_hz=(10, 500), tol=1e-6)
before = medium.reduce(tol=1e-5)


def interrupted(work, after: float) -> bool:
    # From outside: a thread of this process would wait for the interpreter.
    subprocess.Popen(["sh", "-c", f"sleep {after}; kill -INT {os.getpid()}"])
    try:
        while True:
            work()
    except KeyboardInterrupt:
        return True


optimal = {"mor_second_stage": "optimal"}
for after in seconds:
    print(
        "certify", interrupted(lambda: flexgram.certify(body, band_hz=(10, 500), tol=1e-6), after)
    )
    print("cut", interrupted(lambda: medium.reduce(order=before.order, options=optimal), after))
again = medium.reduce(tol=1e-5)
omega = 2 * np.pi * 123.4
difference = np.abs(again.transfer(omega) - before.transfer(omega)).max()
print("equal", bool(difference <= 1e-9 * np.abs(before.transfer(omega)).max()))
new = flexgram.reduce(body, band_hz=(10, 500), tol=1e-5)
print("order", new.order == before.order, new.kind)
