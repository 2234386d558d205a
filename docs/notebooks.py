"""Notebooks with results: `notebooks/NAME.ipynb` from the script `notebooks/NAME.py`.

    python docs/notebooks.py [--check] [NAME...]      # or: make notebooks, make check-notebooks

Every notebook runs from its first cell to its last. Its metadata hold the SHA-256 of its script.
The first picture of the cell `# %% picture=[LEFT, TOP, RIGHT, BOTTOM]` becomes
`notebooks/pictures/NAME.png` for the list of notebooks, cut to these fractions of its width and
height. With `--check` no file is written: the words and durations of the results are compared with
those of the stored notebook.
"""

import argparse
import base64
import difflib
import hashlib
import io
import json
import math
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from PIL.Image import Image

NOTEBOOKS = Path(__file__).parents[1] / "notebooks"
PICTURES = NOTEBOOKS / "pictures"
MAX_NOTEBOOK_SIZE = 400_000  # bytes; code hosts show no larger ones in full
MAX_PICTURE_SIZE = 40_000  # bytes, of a picture in the list of notebooks
REMEDY = "run `make notebooks`"
# Code hosts show a notebook about 1,000 pixels wide: at this resolution, no figure is shrunk much.
_RESOLUTION = 90  # dots per inch
_EXACT_COLORS = 64  # of the 256 colours of a picture
_LIST_SIZE = 480, 360  # of a picture in the list of notebooks [px]
_PNG = "image/png"
_TEXT_OF_METADATA = {"file_extension": ".py", "mimetype": "text/x-python", "name": "python"}
_ABSOLUTE_PATH = re.compile(r"(?<![\w./~])/(?:home|opt|private|root|tmp|usr|Users|var|work)/\S*")
_NUMBER = r"[-+]?\d+(?:\.\d*)?(?:e[-+]?\d+)?"
_DURATION = re.compile(rf"({_NUMBER}) s\b")
_DURATION_TOLERANCE = 0.1  # relative; other processors round otherwise

Notebook = dict[str, Any]


def script_names() -> list[str]:
    """Return the names of all scripts, without ending."""
    return [path.stem for path in sorted(NOTEBOOKS.glob("*.py"))]


def script_hash(name: str) -> str:
    """Return the SHA-256 of a script."""
    return hashlib.sha256((NOTEBOOKS / f"{name}.py").read_bytes()).hexdigest()


# ---- Tests of a stored notebook. They need no library of notebooks.


def faults(notebook: bytes, sha256: str) -> list[str]:
    """Return the faults of a stored notebook, each with its remedy.

    Args:
        notebook: Contents of the file.
        sha256: Hash of its script.
    """
    content = json.loads(notebook)
    messages = []
    if content["metadata"].get("tubeplanner", {}).get("script_sha256") != sha256:
        messages.append(f"the script has changed since the notebook was made; {REMEDY}")
    if len(notebook) > MAX_NOTEBOOK_SIZE:
        messages.append(
            f"{len(notebook) / 1000:.0f} kB are more than {MAX_NOTEBOOK_SIZE / 1000:.0f} kB; "
            f"draw fewer or smaller figures and {REMEDY}"
        )
    cells = [cell for cell in content["cells"] if cell["cell_type"] == "code"]
    if [cell["execution_count"] for cell in cells] != list(range(1, len(cells) + 1)):
        messages.append(f"not every cell has run, in order; {REMEDY}")
    outputs = [output for cell in cells for output in cell["outputs"]]
    if not any(_PNG in output.get("data", {}) for output in outputs):
        messages.append(f"no output is a picture; {REMEDY}")
    for number, cell in enumerate(cells, start=1):
        for output in cell["outputs"]:
            messages += [f"cell {number}: {fault}" for fault in _output_faults(output)]
    return messages


def _output_faults(output: Notebook) -> list[str]:
    """Return the faults of one output of a cell."""
    if output["output_type"] == "error":
        return [f"error {output['ename']}: {output['evalue']}"]
    if output.get("name") == "stderr":
        return [f"warning: {_joined(output['text'])}"]
    messages = []
    if paths := _ABSOLUTE_PATH.findall(_text(output)):
        messages.append(f"path of this machine: {', '.join(paths)}")
    if unseen := output.get("data", {}).keys() - {_PNG, "text/plain"}:
        messages.append(f"code hosts show no {', '.join(sorted(unseen))}")
    return messages


def _joined(text: str | list[str]) -> str:
    return text if isinstance(text, str) else "".join(text)


def _text(output: Notebook) -> str:
    """Return the text of an output."""
    return _joined(output.get("text") or output.get("data", {}).get("text/plain", ""))


def differences(stored: Notebook, made: Notebook) -> list[str]:
    """Return the differences between the results of two runs of a notebook.

    Words must be equal, and durations in seconds must agree to 10 %. Other numbers may differ, as
    other processors round otherwise; of pictures, their number counts.
    """
    old, new = _results(stored), _results(made)
    lines = list(difflib.unified_diff(_words(old), _words(new), "stored", "made", "", "", 0, ""))
    if lines:
        return lines
    pairs = zip(_DURATION.findall(old), _DURATION.findall(new), strict=True)
    return [
        f"{before} s is {after} s now"
        for before, after in pairs
        if not math.isclose(float(before), float(after), rel_tol=_DURATION_TOLERANCE)
    ]


def _results(notebook: Notebook) -> str:
    """Return the texts of all outputs, with a line for each picture."""
    lines = []
    for cell in notebook["cells"]:
        for output in cell.get("outputs", ()):
            is_picture = _PNG in output.get("data", {})
            lines.append("(picture)" if is_picture else _text(output))
    return "\n".join(lines)


def _words(results: str) -> list[str]:
    """Return results line by line, with a mark in place of each number."""
    lines = re.sub(_NUMBER, "#", results).splitlines()
    return [" ".join(re.sub(r"([\[\]])", r" \1 ", line).split()) for line in lines]


# ---- Runs of scripts.


def run_script(name: str) -> Notebook:
    """Run a script as a notebook in a new kernel; return the notebook with its results.

    Raises:
        CellExecutionError: A cell raised an exception.
    """
    import jupytext
    from nbclient import NotebookClient

    path, sha256 = NOTEBOOKS / f"{name}.py", script_hash(name)
    notebook = jupytext.read(path)
    # Ids of cells are random otherwise.
    for number, cell in enumerate(notebook.cells):
        cell["id"] = f"cell-{number}"
    figures = {"dpi": _RESOLUTION, "bbox_inches": "tight"}
    client = NotebookClient(
        notebook,
        timeout=None,
        kernel_name="python3",
        record_timing=False,
        coalesce_streams=True,
        resources={"metadata": {"path": str(NOTEBOOKS)}},
        extra_arguments=["--log-level=ERROR", f"--InlineBackend.print_figure_kwargs={figures}"],
    )
    client.execute()
    kernel = notebook.metadata["kernelspec"]
    notebook.metadata = {
        "kernelspec": kernel,
        "language_info": {**_TEXT_OF_METADATA, "pygments_lexer": "ipython3"},
        "tubeplanner": {"script": path.name, "script_sha256": sha256},
    }
    for cell in notebook.cells:
        for output in cell.get("outputs", ()):
            if picture := output.get("data", {}).get(_PNG):
                small = small_png(base64.b64decode(picture))
                output["data"][_PNG] = base64.b64encode(small).decode()
    return notebook


def list_picture(notebook: Notebook) -> bytes:
    """Return the picture of a notebook for the list of notebooks, as PNG."""
    (cell,) = (cell for cell in notebook["cells"] if "picture" in cell["metadata"])
    outputs = [output.get("data", {}) for output in cell["outputs"]]
    picture = next(data[_PNG] for data in outputs if _PNG in data)
    return small_png(base64.b64decode(picture), _LIST_SIZE, cell["metadata"]["picture"])


def small_png(
    png: bytes, size: tuple[int, int] | None = None, part: Sequence[float] = (0, 0, 1, 1)
) -> bytes:
    """Return a part of a PNG with 256 colours.

    Args:
        png: The picture.
        size: Largest width and height [px]; None: those of the picture.
        part: Left, top, right and bottom of the part, as fractions of width and height.
    """
    from PIL import Image

    image = Image.open(io.BytesIO(png)).convert("RGB")
    box = [round(x * length) for x, length in zip(part, 2 * image.size, strict=True)]
    image = image.crop((box[0], box[1], box[2], box[3]))
    if size is not None:
        image.thumbnail(size, Image.Resampling.LANCZOS)
    stream = io.BytesIO()
    _with_palette(image).save(stream, "png", optimize=True)
    return stream.getvalue()


def _with_palette(image: "Image") -> "Image":
    """Return an image with 256 colours.

    The most frequent colours stay as they are. Pillow alone merges pale backgrounds (MAXCOVERAGE)
    or loses the colours of thin lines (MEDIANCUT).
    """
    from PIL import Image

    pixels = np.asarray(image, dtype=np.uint32) @ np.array([1 << 16, 1 << 8, 1], dtype=np.uint32)
    codes, index, counts = np.unique(pixels, return_inverse=True, return_counts=True)
    colors = (codes[:, None] >> np.array([16, 8, 0]) & 255).astype(np.uint8)
    order = np.argsort(-counts, kind="stable")
    palette = colors[order[:256]]
    if len(colors) > 256:
        rare = Image.fromarray(colors[order[_EXACT_COLORS:]][None])
        rare = rare.quantize(256 - _EXACT_COLORS, Image.Quantize.MAXCOVERAGE, kmeans=3)
        further = np.array(rare.getpalette(), dtype=np.uint8).reshape(-1, 3)
        palette = np.vstack([palette[:_EXACT_COLORS], further])[:256]
    distance = np.linalg.norm(colors[:, None, :] - palette.astype(float), axis=2)
    nearest = distance.argmin(axis=1).astype(np.uint8)
    result = Image.fromarray(nearest[index].reshape(pixels.shape))
    result.putpalette(palette.tobytes())
    return result


def main(arguments: Sequence[str] | None = None) -> int:
    """Make or check notebooks; return 1 if one has a fault."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", default=script_names())
    parser.add_argument("--check", action="store_true", help="write no file; compare the results")
    options = parser.parse_args(arguments)
    has_faults = False
    for name in options.names:
        messages = _check(name) if options.check else _make(name)
        print(f"notebooks/{name}.ipynb:", *(messages or ["passed"]), sep="\n  ", flush=True)
        has_faults |= bool(messages)
    return int(has_faults)


def _contents(notebook: Notebook) -> bytes:
    import nbformat

    return (nbformat.writes(notebook) + "\n").encode()


def _make(name: str) -> list[str]:
    """Run a script and write its notebook and its picture; return the faults."""
    notebook = run_script(name)
    contents = _contents(notebook)
    messages = faults(contents, script_hash(name))
    (NOTEBOOKS / f"{name}.ipynb").write_bytes(contents)
    PICTURES.mkdir(exist_ok=True)
    (PICTURES / f"{name}.png").write_bytes(list_picture(notebook))
    return messages


def _check(name: str) -> list[str]:
    """Run a script; return the faults and the differences from the stored notebook."""
    notebook = run_script(name)
    messages = faults(_contents(notebook), script_hash(name))
    stored = json.loads((NOTEBOOKS / f"{name}.ipynb").read_bytes())
    if changes := differences(stored, notebook):
        messages += [f"other results than in the notebook; {REMEDY}", *changes]
    return messages


if __name__ == "__main__":
    sys.exit(main())
