"""Pictures of README and these pages: the commands that make them, and a sentence on each.

    python docs/gallery.py [NAME...]      # or: make gallery

Without names all of them, which takes some minutes. Commands run in an empty folder and write what
pages show under the name that it has there. Pictures of pages need Chromium; where there is none
they stay as they are.
"""

import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

DOCS = Path(__file__).parent
_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
_FLAGS = (
    *("--headless=new", "--no-sandbox", "--no-first-run", "--disable-dev-shm-usage"),
    *("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--virtual-time-budget=3000"),
    *("--run-all-compositor-stages-before-draw", "--host-resolver-rules=MAP * ~NOTFOUND"),
    "--window-size=1200,760",
)


class Picture(NamedTuple):
    """A picture of the gallery.

    Attributes:
        commands: What makes it, one a line; the last one writes NAME.png (or the ending that is
            stated), or NAME.html.
        seen: What is to be seen in it.
        instant: Of a page: at what time it is shown [s]; None: the picture is no page's.
        problem: The page here whose first problem file the commands take as problem.yaml.
        ending: Of its file.
    """

    commands: str
    seen: str
    instant: float | None = None
    problem: str | None = None
    ending: str = "png"


PICTURES = {
    "demo": Picture(
        "python docs/moving_picture.py demo.webp",
        "The cycle of `make demo`, in real time: the tool stays in the tube of each move, no curve "
        "crosses its limit, and the beaker stays on its tray.",
        ending="webp",
    ),
    "over_the_wall": Picture(
        "tubeplanner plan example:ur5/over_the_wall --plot over_the_wall.png",
        "Some limit on the speed binds nearly all the time: the motion could hardly be faster.",
    ),
    "waiter": Picture(
        "tubeplanner plan example:ur5/waiter --plot waiter.png",
        "A tray leans into the motion: what holds the glass binds most of the time.",
    ),
    "compared": Picture(
        "tubeplanner compare example:two_link/paper_5_50mm --quality fast --plot compared.png",
        "Solid bars are certified; hatched bars fail the named condition; grey: the fastest one.",
    ),
    "executed": Picture(
        "tubeplanner plan example:ur10/onto_a_conveyor -o t.json\n"
        "tubeplanner simulate example:ur10/onto_a_conveyor t.json --plot executed.png",
        "Arms that differ from the model leave the tube where the elbow's motor is at its limit.",
    ),
    "swept": Picture(
        "tubeplanner sweep example:ur5/over_the_wall "
        "--vary robustness.com=0,0.005,0.01,0.02,0.04 --plot swept.png",
        "A larger error of the links' centres of mass makes the robust motion slower.",
    ),
    "pick": Picture(
        "tubeplanner plan problem.yaml --plot pick.png",
        "A part leaves its table upwards and comes down on it: acceleration and jerk bind.",
        problem="how_to/contacts.md",
    ),
    "effort_curves": Picture(
        "python docs/gallery_figures.py effort_curves effort_curves.png",
        "The shortest motion swings between effort limits; 0.5 % more time makes it smooth.",
    ),
    "motor_curves": Picture(
        "python docs/gallery_figures.py motor_curves motor_curves.png",
        "Efforts over velocities stay inside what each motor has; friction takes its fraction.",
    ),
    "convergence": Picture(
        "python docs/gallery_figures.py convergence convergence.png",
        "The duration falls step by step, on few knots first, then on finer ones.",
    ),
    "study_map": Picture(
        "tubeplanner study example:ur5/tolerance_and_payload --plot study_map.png",
        "The duration is short where the tube is wide and the payload light.",
    ),
    "placement": Picture(
        "tubeplanner place example:ur5/over_the_wall --region=-0.5,0.6,-0.7,0.7 "
        "--stands-on table --plot placement.png",
        "Behind its table and turned away the UR5 needs 16 % less time than at the given place.",
    ),
    "view_ur5": Picture(
        "tubeplanner plan example:ur5/over_the_wall --html view_ur5.html",
        "The page: a UR5 in its tube, the tool's path coloured by speed.",
        0.25,
    ),
    "view_panda": Picture(
        "tubeplanner plan example:panda/between_shelves --html view_panda.html",
        "A Panda between two shelves.",
        0.4,
    ),
    "view_held": Picture(
        "tubeplanner plan example:ur10/suction_cup --html view_held.html",
        "A part on a suction cup: the arrow of its apparent gravity, and where its tip may be.",
        0.3,
    ),
    "view_two_link": Picture(
        "tubeplanner plan example:two_link/around_a_post --html view_two_link.html",
        "A planar arm moves around a post.",
        0.4,
    ),
    "view_cycle": Picture(
        "tubeplanner plan example:ur5/through_the_door --html view_cycle.html",
        "A whole cycle: below, the time line with moves, events and dwells.",
        0.9,
    ),
}


def gallery() -> str:
    """Return the gallery as Markdown: each picture, what is seen in it and what makes it."""
    return "\n\n".join(
        f"## {name}\n\n{picture.seen}\n\n```sh\n{picture.commands}\n```\n\n"
        f"![{picture.seen}]({name}.{picture.ending})"
        for name, picture in PICTURES.items()
    )


def draw(name: str, folder: Path) -> None:
    """Make a picture in a folder and put it where pages show it."""
    picture = PICTURES[name]
    browser = next(filter(None, map(shutil.which, _BROWSERS)), None)
    if picture.instant is not None and browser is None:
        print(f"{name}: left as it is, there is no Chromium")
        return
    if picture.problem is not None:
        page = (DOCS / picture.problem).read_text(encoding="utf-8")
        (folder / "problem.yaml").write_text(page.split("```yaml\n")[1].split("```")[0])
    for line in picture.commands.splitlines():
        command = [sys.executable, *_arguments(shlex.split(line))]
        subprocess.run(command, cwd=folder, check=True, stdout=subprocess.DEVNULL)
    target = folder / f"{name}.{picture.ending}"
    if picture.instant is not None and browser is not None:
        page = f"{(folder / f'{name}.html').as_uri()}#t={picture.instant}"
        more = [f"--user-data-dir={folder / 'profile'}", f"--screenshot={target}"]
        subprocess.run(
            [browser, *_FLAGS, *more, page], check=True, timeout=100, stderr=subprocess.DEVNULL
        )
    shutil.copyfile(target, DOCS / target.name)
    print(DOCS / target.name)


def _arguments(words: list[str]) -> list[str]:
    """Return what Python is called with for the words of a command."""
    program, *rest = words
    if program == "python":
        return [str(DOCS.parent / rest[0]), *rest[1:]]
    return ["-c", "from tubeplanner.cli.start import run; raise SystemExit(run())", *rest]


def main(names: list[str]) -> int:
    """Make pictures; return 2 if there is none of such a name."""
    for name in names:
        if name not in PICTURES:
            print(f"there is no picture {name}; there is: {', '.join(PICTURES)}")
            return 2
    for name in names or PICTURES:
        with tempfile.TemporaryDirectory() as folder:
            draw(name, Path(folder))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
