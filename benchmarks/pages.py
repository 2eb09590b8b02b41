"""How soon a page shows the body: first paint in a headless Chromium that runs already.

Pages of the rack, of a block of 100,000 dofs (Tet10) and of an assembly of two racks, and an empty
page. Each is opened three times from another page of a local server; the browser's own clock counts
from the click (PaintTiming). Writes benchmarks/results/pages.csv.
"""

from __future__ import annotations

import http.server
import json
import queue
import shutil
import statistics
import subprocess
import tempfile
import threading
from pathlib import Path
from typing import Any

from common import OUT, RESULTS, ROOT, flexgram, write_table
from methods import SHAPES

from bodies import box, write_body_file
from flexgram import ReducedModel, import_body
from flexgram.assembly.couple import Joint, couple
from flexgram.pictures.report import write_report

RUNS = 3
START = b"<!doctype html><h1>start</h1><script>setTimeout(() => location.href = '/', 2500)</script>"
TELL = b"""<script>addEventListener("load", () => setTimeout(() => {
  const said = {};
  for (const one of performance.getEntriesByType("paint")) said[one.name] = one.startTime;
  fetch("/said", {method: "POST", body: JSON.stringify(said)});
}, 3000));</script>"""
CHROMIUM = (
    *("--headless=new", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader"),
    *("--enable-unsafe-swiftshader", "--window-size=1100,2000", "--remote-debugging-port=0"),
)


def first_paint(page: bytes) -> float:
    """Milliseconds from the click to the first paint with content."""
    said: queue.Queue[dict[str, float]] = queue.Queue()

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            known = {"/start": START, "/": page}
            self.send_response(200 if self.path in known else 404)
            self.end_headers()
            self.wfile.write(known.get(self.path, b""))

        def do_POST(self) -> None:
            said.put(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(200)
            self.end_headers()

        def log_message(self, *_: Any) -> None:
            """Nothing."""

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    chromium = shutil.which("chromium")
    assert chromium, "Chromium is not installed"
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        address = f"http://127.0.0.1:{server.server_port}/start"
        browser = subprocess.Popen(
            [chromium, *CHROMIUM, f"--user-data-dir={profile}", address],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            return said.get(timeout=60)["first-contentful-paint"]
        finally:
            browser.kill()
            browser.wait()
            server.shutdown()


def reports() -> dict[str, Path]:
    """Pages by what they are of."""
    pages = {}
    import_body(ROOT / "meshes" / "rack.yaml", OUT / "rack.h5")
    flexgram("reduce", OUT / "rack.h5", "--band", "10,500", "--tol", "1e-4", "-o", OUT / "r.rom.h5")
    pages["the rack"] = OUT / "r.rom.h5"
    mesh = box("tetra10", SHAPES["block"][0][100], SHAPES["block"][1], distort=False)
    ends = {name: {"set": name, "coupling": "rigid"} for name in ("start", "end")}
    write_body_file(OUT / "b.h5", mesh, interfaces=ends, damping=(2.0, 1e-6, 0))
    flexgram("reduce", OUT / "b.h5", "--band", "10,1000", "--tol", "1e-4", "-o", OUT / "b.rom.h5")
    pages["block, 102,675 dofs"] = OUT / "b.rom.h5"
    rack = ReducedModel.load(OUT / "r.rom.h5")
    tower = couple({"a": rack, "b": rack}, [Joint("a.upper", "b.lower")])
    tower.save(OUT / "tower.rom.h5")
    pages["two racks, coupled"] = OUT / "tower.rom.h5"
    for path in pages.values():
        write_report(path, path.with_suffix(".html"))
    return {name: path.with_suffix(".html") for name, path in pages.items()}


def main() -> None:
    OUT.mkdir(parents=True, exist_ok=True)
    empty = OUT / "empty.html"
    empty.write_text("<!doctype html><h1>empty</h1>")
    rows = []
    for name, path in {"an empty page": empty, **reports()}.items():
        page = path.read_bytes()
        begin, end, rest = page.rpartition(b"</body>")
        told = begin + TELL + end + rest if end else page + TELL
        times = sorted(first_paint(told) for _ in range(RUNS))
        rows.append(
            {
                "page": name,
                "MB": f"{len(page) / 1e6:.1f}",
                "first paint [ms]": f"{statistics.median(times):.0f}",
                "all": " ".join(f"{t:.0f}" for t in times),
            }
        )
        print(*rows[-1].values(), sep="  ", flush=True)
    write_table(RESULTS / "pages.csv", rows)


if __name__ == "__main__":
    main()
