"""A script for MATLAB and Octave with its data: loads a reduced body, draws H, simulates a step."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import scipy.io

from flexgram.basics import BodyError, written_aside
from flexgram.body.laws import Law
from flexgram.exporters.arrays import write_mat
from flexgram.model.reduced import ReducedBody

#: Words that the script does not use, but the language does.
TAKEN = {
    "break",
    "case",
    "catch",
    "classdef",
    "continue",
    "else",
    "elseif",
    "function",
    "global",
    "otherwise",
    "parfor",
    "persistent",
    "return",
    "spmd",
    "switch",
    "try",
    "while",
    "do",
    "until",
    "endif",
    "endfor",
    "ans",
    "quiet",
}

SCRIPT = """% Reduced body by flexgram: {claim}
% b.M q'' + b.D q' + (b.K (1 + i b.eta) + i b.S{terms}) q = b.B u, in SI units;
% y = b.C q + b.C_rate q' + b.feedthrough u, with structural damping also i b.output_eta .* (b.C q).
% Set `quiet = true` to be spared the figures.
here = fileparts(mfilename('fullpath'));
b = load(fullfile(here, '{data}'));
output = {output};  % its name: b.outputs{{output}}
input = {input};

% Transfer function over the band
H = @(w) (b.C + 1i * w * b.C_rate + 1i * diag(b.output_eta) * b.C) * ...
  ((b.K * (1 + 1i * b.eta) + 1i * b.S{stiffness} + ...
    1i * w * b.D - w^2 * b.M) \\ b.B) + b.feedthrough;
f = linspace({first:.9g}, {last:.9g}, 500);
h = zeros(size(f));
for k = 1:numel(f)
  all_ports = H(2 * pi * f(k));
  h(k) = all_ports(output, input);
end

% Natural frequencies [Hz]; of a free body the first are rigid
natural = sqrt(max(sort(real(eig(b.K, b.M))), 0)) / (2 * pi);
"""
STEP = """
% Response to a unit step of the input, exact between the times: x = [q; q']
m = size(b.M, 1);
A = [zeros(m), eye(m); -(b.M \\ b.K), -(b.M \\ b.D)];
G = [zeros(m, 1); b.M \\ b.B(:, input)];
t = linspace(0, {end:.9g}, 1001)';
step = expm([A, G; zeros(1, 2 * m + 1)] * (t(2) - t(1)));
x = zeros(2 * m + 1, numel(t));
x(end, :) = 1;
for k = 2:numel(t)
  x(:, k) = step * x(:, k - 1);
end
y = (b.C * x(1:m, :) + b.C_rate * x(m + 1:2 * m, :) + b.feedthrough(:, input))';
"""
FIGURES = """
without_display = exist('OCTAVE_VERSION', 'builtin') && isempty(available_graphics_toolkits());
if without_display
  disp('no figures: this Octave has no display');
elseif ~exist('quiet', 'var') || ~quiet
  figure;
  semilogy(f, abs(h));
  xlabel('frequency [Hz]');
  ylabel([b.outputs{{output}}, ' from ', b.inputs{{input}}], 'Interpreter', 'none');
  title('{title}', 'Interpreter', 'none');
  grid on;
{second}end
"""
SECOND = """  figure;
  plot(t, y(:, output));
  xlabel('time [s]');
  ylabel([b.outputs{{output}}, ' after a step of ', b.inputs{{input}}], 'Interpreter', 'none');
  grid on;
"""


def _strongest(model: ReducedBody) -> tuple[int, int]:
    """Output and input of the largest entry of H in the middle of the band, from forces if any."""
    H = np.abs(model.system.transfer(float(np.mean(model.claim.band))))
    forces = [name.rpartition(".")[2].startswith("f") for name in model.inputs]
    if any(forces):
        H[:, ~np.array(forces)] = 0
    output, port = np.unravel_index(int(np.argmax(H)), H.shape)
    return int(output), int(port)


def _is_ours(path: Path) -> bool:
    try:
        names = {name for name, *_ in scipy.io.whosmat(path)}
    except Exception:  # scipy's many, of what is no MATLAB file
        return False
    return {"M", "D", "K", "B", "C", "eta", "sigma"} <= names


def _factor(k: int, law: Law) -> str:
    """g(w) of the k-th term."""
    if law.kind == "prony":
        z = f"1i * w * b.term_{k}_tau(:)"
        return f"sum(b.term_{k}_g(:) .* ({z}) ./ (1 + {z}))"
    if law.kind == "circulatory":
        return "1"
    values, at = f"b.term_{k}_storage + 1i * b.term_{k}_loss", f"b.term_{k}_omega"
    if len(law.numbers()["omega"]) == 1:
        return f"({values})"
    return f"interp1({at}, {values}, min(max(w, {at}(1)), {at}(end)))"


def write_octave(model: ReducedBody, path: Path, body: str | Path | None = None) -> None:
    """``NAME.m``, and ``NAME.m.mat`` with its data beside it (``write_mat``).

    Raises
    ------
    BodyError
        If the name is none of a script, or the data file would replace one of others.
    """
    name = path.name.removesuffix(".m")
    if path.suffix != ".m" or not (name.isascii() and name.isidentifier() and name[0] != "_"):
        raise BodyError(
            f"{path}: MATLAB's scripts are letters, digits and _ with .m behind, as rack_reduced.m"
        )
    if name in TAKEN or name in re.findall(r"[a-z]\w*", SCRIPT + STEP + FIGURES + SECOND):
        raise BodyError(f"{path}: {name} is a word of the language: name it {name}_reduced.m, say")
    data = path.with_name(f"{name}.m.mat")
    if data.exists() and not _is_ours(data):
        raise BodyError(f"{data} is there, and not of such a script: another name")
    output, port = _strongest(model)
    slowest = float(model.elastic_frequencies.min(initial=float(model.claim.band[-1])))
    values = {
        "claim": model.claim.words,
        "data": data.name,
        "output": output + 1,
        "input": port + 1,
        "first": model.claim.band[0] / (2 * np.pi),
        "last": model.claim.band[-1] / (2 * np.pi),
        "end": 20 * np.pi / slowest,
        "title": name,
    }
    laws = [_factor(k, term.law) for k, term in enumerate(model.system.terms, 1)]
    values["stiffness"] = "".join(f" + ...\n    {g} * b.term_{k}" for k, g in enumerate(laws, 1))
    values["terms"] = "".join(f" + g(w) b.term_{k}" for k in range(1, len(laws) + 1))
    moves = not model.system.loss  # structural damping has no real time-domain form
    second = SECOND.format(**values) if moves else ""
    text = SCRIPT.format(**values) + (STEP.format(**values) if moves else "")
    text += FIGURES.format(**values, second=second)
    write_mat(model, data, model.path, body)
    with written_aside(path, model.path, body) as place:
        place.write_text(text)
