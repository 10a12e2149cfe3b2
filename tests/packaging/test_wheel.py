"""sdist -> wheel -> an environment that holds the wheel and no checkout, used from elsewhere."""

from __future__ import annotations

import hashlib
import importlib.util
import json
import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import venv
import zipfile
from pathlib import Path

import pytest
from doc_pages import Block, Reader, blocks

from deltact_fab.bench.record.run import open_run
from deltact_fab.common.catalog import toml_text

ROOT = Path(__file__).parents[2]
CATALOGUE = ("cad", "patterns", "protocols")
# Whatever else lies in a checkout (environments, run folders, caches) stays there.
TRAVELS = {
    *CATALOGUE, "benchmarks", "deltact_fab", "examples", "tests", "docs", ".ci", ".gitignore",
    "Makefile", "README.md", "CHANGELOG.md", "CITATION.cff", "CONTRIBUTING.md", "LICENSE",
    "PKG-INFO", "constraints.txt", "pyproject.toml",
}  # fmt: skip
SHORT = {
    "name": "short", "indenters": ["sphere:10"], "positions_mm": [[0.0, 0.0]], "depths_mm": [0.6],
    "channels": ["image", "dots", "force"], "capture": {"rate_hz": 0.5},
}  # fmt: skip
WHERE = """
import json, sys, deltact_fab
print(json.dumps({"package": deltact_fab.__file__, "path": sys.path}))
"""


def ended(*words: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run a program as a stranger would: nothing in the environment points to the checkout."""
    drop = {"PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV"}
    env = {k: v for k, v in os.environ.items() if k not in drop}
    return subprocess.run(
        [str(w) for w in words],
        capture_output=True, text=True, cwd=cwd, env=env, timeout=1200, check=False,
    )  # fmt: skip


def call(*words: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    """As `ended`, of a program that must not fail."""
    done = ended(*words, cwd=cwd)
    assert done.returncode == 0, f"{words}: {done.stdout}{done.stderr}"
    return done


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the sdist of this checkout and the wheel made from that sdist."""
    dist = tmp_path_factory.mktemp("dist")
    build = (sys.executable, "-m", "hatchling", "build", "-d", str(dist), "-t")
    call(*build, "sdist", cwd=ROOT)
    unpacked = tmp_path_factory.mktemp("sdist")
    call("tar", "-xf", str(next(dist.glob("*.tar.gz"))), cwd=unpacked)
    (source,) = unpacked.iterdir()
    call(*build, "wheel", cwd=source)
    return dist


@pytest.fixture(scope="module")
def wheel(built: Path) -> Path:
    (made,) = built.glob("*.whl")
    return made


def borrowed(wheel: Path, folder: Path) -> Path:
    """Programs of a fresh environment with the wheel, which borrows the dependencies from here.

    A .pth names this environment's packages; .pth files in there are not read in turn, and one
    of those is what makes an editable checkout importable.
    """
    environment = folder / "env"
    venv.EnvBuilder(with_pip=False, symlinks=True).create(environment)
    call(
        sys.executable, "-m", "pip", "-q", "--disable-pip-version-check",
        "--python", environment / "bin" / "python",
        "install", "--no-deps", "--no-index", "--no-compile", wheel,
        cwd=folder,
    )  # fmt: skip
    (packages,) = environment.glob("lib/python*/site-packages")
    (packages / "borrowed.pth").write_text(sysconfig.get_paths()["purelib"] + "\n")
    return environment / "bin"


def of_the_checkout(*folders: str) -> dict[str, bytes]:
    """What a person put under those folders, by path."""
    found = (p for folder in folders for p in (ROOT / folder).rglob("*"))
    return {
        p.relative_to(ROOT).as_posix(): p.read_bytes()
        for p in found
        if p.is_file() and "__pycache__" not in p.parts
    }


@pytest.mark.slow
def test_sdist_contents(built: Path) -> None:
    with tarfile.open(next(built.glob("*.tar.gz"))) as archive:
        names = {name.split("/", 1)[1] for name in archive.getnames()}
    assert {name.split("/")[0] for name in names} == TRAVELS
    assert names >= set(
        of_the_checkout("deltact_fab", *CATALOGUE, "tests", "benchmarks", "examples", ".ci")
    )
    assert not [name for name in names if "__pycache__" in name or name.endswith(".pyc")]


def test_wheel_contents(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        held = {name: archive.read(name) for name in archive.namelist()}
    info = next(name for name in held if name.endswith("/METADATA")).split("/")[0]
    wanted = of_the_checkout("deltact_fab")
    wanted |= {f"deltact_fab/_shipped/{k}": v for k, v in of_the_checkout(*CATALOGUE).items()}
    assert {k: v for k, v in held.items() if not k.startswith(info)} == wanted
    assert {"deltact_fab/py.typed", "deltact_fab/_shipped/protocols/rigs/virtual.toml"} <= {*wanted}
    assert b"deltact-fab = deltact_fab.app.cli.main:entry" in held[f"{info}/entry_points.txt"]
    assert b"://" not in b"".join(
        line for line in held[f"{info}/METADATA"].splitlines() if line.startswith(b"Requires-Dist")
    )


def check_run(folder: Path, frames: int) -> None:
    """As many images as the summary says, each with the hash of its row."""
    rows = open_run(folder).frames()
    assert len(rows) == frames >= 3
    for row in rows.itertuples():
        data = (folder / str(row.file)).read_bytes()
        assert hashlib.sha256(data).hexdigest() == row.sha256
    assert rows["fz_n"].min() < -0.1


def pythons() -> dict[tuple[int, ...], str]:
    """Each Python here that the package is for, by version, as PATH and pyenv have it."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    found = [shutil.which(f"python3.{minor}") for minor in range(11, 20)]
    found += [str(path) for path in pyenv.glob("versions/3.*/bin/python")]
    versions: dict[tuple[int, ...], str] = {}
    for program in filter(None, found):
        done = ended(program, "-c", "import sys; print(*sys.version_info[:2])", cwd=ROOT)
        if done.returncode == 0:  # a shim of pyenv may have nothing behind it
            versions.setdefault(tuple(map(int, done.stdout.split())), program)
    return {version: path for version, path in versions.items() if version >= (3, 11)}


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("uv") is None, reason="uv is not installed")
@pytest.mark.parametrize("which", ["oldest, lowest versions", "this one, pinned", "newest, pinned"])
def test_install_from_index_runs_and_reports(
    which: str, wheel: Path, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    """Every dependency is installed anew; the oldest Python takes the least that is declared."""
    here, this = pythons(), sys.version_info[:2]
    version = {"o": min(here), "t": this, "n": max(here)}[which[0]]
    if which[0] == "n" and version == this:
        pytest.skip(f"no newer Python than {version} is here")
    environment, elsewhere = tmp_path / "env", tmp_path / "elsewhere"
    elsewhere.mkdir()
    # 2 GB; pytest would keep the last three.
    request.addfinalizer(lambda: shutil.rmtree(environment, ignore_errors=True))
    uv, python = (sys.executable, "-m", "uv", "-q"), environment / "bin" / "python"
    program = sys.executable if version == this else here[version]
    call(*uv, "venv", "--no-project", "--python", program, environment, cwd=tmp_path)
    install = (*uv, "pip", "install", "--python", python)
    if which[0] == "o":
        # Of a wheel its own requirements are not direct ones; of a checkout they are.
        call(*install, "--resolution", "lowest-direct", f"{ROOT}[report]", cwd=tmp_path)
        call(*install, "--no-deps", "--reinstall-package", "deltact-fab", wheel, cwd=tmp_path)
    else:
        extras = "cad,report" if which[0] == "t" else "report"
        pins = ("-c", str(ROOT / "constraints.txt"))
        call(*install, *pins, f"{wheel}[{extras}]", cwd=tmp_path)

    def there(*words: str) -> str:
        return call(environment / "bin" / "deltact-fab", *words, cwd=elsewhere).stdout

    seen = json.loads(call(python, "-c", WHERE, cwd=elsewhere).stdout)
    assert seen["package"].startswith(str(environment))
    assert not {str(ROOT), sysconfig.get_paths()["purelib"]} & set(seen["path"])
    if which[0] == "t":
        there("cad", "export", "sphere:10", "--out", "parts")
        assert (elsewhere / "parts" / "manifest.json").is_file()
    (elsewhere / "short.toml").write_text(toml_text(SHORT))
    summary = json.loads(there("run", "short.toml", "--seed", "3", "--out", "r", "--json"))
    check_run(elsewhere / "r", summary["frames"])
    there("report", "r", "-o", "r.html")
    assert "simulated" in (elsewhere / "r.html").read_text()


@pytest.mark.slow
def test_the_first_hour_can_be_followed(
    wheel: Path, tmp_path_factory: pytest.TempPathFactory, tmp_path: Path
) -> None:
    """The tutorial's own blocks, from `init` to the report, in an empty folder, with the wheel."""
    page = ROOT / "docs" / "tutorials" / "first-hour.md"
    programs = borrowed(wheel, tmp_path_factory.mktemp("borrowed"))

    class Stranger(Reader):
        def python(self, block: Block) -> None:
            call(programs / "python", "-c", block.text, cwd=self.folder)

    def typed(line: str, folder: Path) -> tuple[int, str]:
        done = ended(programs / shlex.split(line)[0], *shlex.split(line)[1:], cwd=folder)
        return done.returncode, done.stdout + done.stderr

    stranger = Stranger(tmp_path, typed)
    stranger.follow(blocks(page))
    assert stranger.folder == tmp_path / "my-lab"
    assert "simulated" in (stranger.folder / "first.html").read_text()
    summary = json.loads((stranger.folder / "first-run" / "summary.json").read_text())
    check_run(stranger.folder / "first-run", summary["frames"])
