# Two commands are the whole set-up: `make demo` and `make test`.
# Run rather than looked up: a name that pyenv puts on the PATH may run nothing.
TESTED := import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))
PYTHON ?= $(shell for p in python3.11 python3.12 python3.13 python3; do \
  $$p -c '$(TESTED)' 2>/dev/null && echo $$p && break; done)
VENV := .venv
V := $(VENV)/bin
# Three workers for two cores, as some wait for a simulated stage; up to 8, as each may take 1 GB.
# JOBS=0: none, all in one process.
JOBS ?= $(shell echo $$((3 * $$(getconf _NPROCESSORS_ONLN) / 2)))
PYTEST := $(V)/python -m pytest -n $(JOBS) --maxprocesses 8 --dist worksteal

.PHONY: demo test test-slow firmware lint docs pins peers evidence clean

# `python -m venv` is missing on a bare Debian; virtualenv, when present, does the same.
$(VENV)/.ready: pyproject.toml constraints.txt
	@p=$(V)/python; test -x $$p || p='$(PYTHON)'; $${p:-false} -c '$(TESTED)' 2>/dev/null \
	  || { echo "make: Python 3.11, 3.12 or 3.13 is needed, not '$$p'; name one as PYTHON=..., remove $(VENV)"; exit 1; }
	@test -x $(V)/python || $(PYTHON) -m venv $(VENV) 2>/dev/null || $(PYTHON) -m virtualenv -q $(VENV) \
	  || virtualenv -q -p $(PYTHON) $(VENV) \
	  || { echo "make: no venv and no virtualenv for $(PYTHON); install one: apt-get install python3-venv"; exit 1; }
	@$(V)/python -m pip --version >/dev/null 2>&1 || $(V)/python -m ensurepip >/dev/null
	@$(V)/python -m pip install -q --disable-pip-version-check uv 2>/dev/null \
	  || echo "make: uv is not to be had here, pip installs instead (slower)"
	@echo "make: installing deltact-fab and its packages into $(VENV) (3.7 GB)"
	@if $(V)/python -m uv --version >/dev/null 2>&1; then \
	  $(V)/python -m uv pip install -q --python $(V)/python -c constraints.txt -e '.[all,test]'; \
	else \
	  $(V)/python -m pip install -q --disable-pip-version-check -c constraints.txt -e '.[all,test]'; \
	fi
	@touch $@

demo: $(VENV)/.ready
	$(V)/deltact-fab demo --out demo-out

STYLE := $(V)/ruff check . && $(V)/ruff format --check . && $(V)/lint-imports

lint: $(VENV)/.ready
	@$(STYLE) && $(V)/mypy

KERNEL := $(V)/python -c "import OCP" 2>/dev/null || { echo "make: the CAD kernel cannot be loaded;\
  apt-get install libgl1 libegl1 libx11-6, or $(V)/deltact-fab doctor"; exit 1; }

# Types are checked beside the tests, and what mypy says comes last: half a minute less to wait.
test: $(VENV)/.ready
	@$(KERNEL)
	@$(STYLE)
	@types=$$(mktemp); $(V)/mypy >"$$types" 2>&1 & mypy=$$!; \
	$(PYTEST); tests=$$?; \
	wait $$mypy; typed=$$?; cat "$$types"; rm "$$types"; test $$tests$$typed = 00

# A file stays with one worker: what its tests share is made once.
test-slow: $(VENV)/.ready
	@$(KERNEL)
	$(PYTEST) --dist loadfile -m 'slow and not evidence'

# A site that needs no network: open site/index.html. A dead link fails.
docs: $(VENV)/.ready
	$(V)/python -m sphinx -q -n -W --keep-going -d .doctrees docs site

pins: $(VENV)/.ready
	$(V)/python -m uv pip compile --universal --all-extras --no-header --no-annotate \
	  --no-emit-index-url --python-version 3.11 -o constraints.txt pyproject.toml

# Programs to compare with whose licence (felupe: GPL-3), pins or size do not fit ours; see
# benchmarks/peers.
peers: .venv-peers/.ready

.venv-peers/.ready: benchmarks/peers/requirements.txt
	@test -x .venv-peers/bin/python || $(PYTHON) -m venv .venv-peers 2>/dev/null \
	  || $(PYTHON) -m virtualenv -q .venv-peers || virtualenv -q -p $(PYTHON) .venv-peers \
	  || { echo "make: no venv and no virtualenv for $(PYTHON); install one: apt-get install python3-venv"; exit 1; }
	@.venv-peers/bin/python -m pip --version >/dev/null 2>&1 || .venv-peers/bin/python -m ensurepip >/dev/null
	.venv-peers/bin/python -m pip install -q --disable-pip-version-check -r $<
	@touch $@

# Firmware under the host, half an hour: a program that you built for this computer, PROGRAM='path
# arguments', or what runs on a terminal, TTY=path; SETTINGS='132=80 ...' where it needs others.
firmware: $(VENV)/.ready
	$(V)/python -m benchmarks.firmware $(if $(TTY),--tty $(TTY)) --settings '$(SETTINGS)' $(PROGRAM)

# Two hours; goes on where it was stopped. Wants the extra `fast`, and `make peers` for felupe's rows.
evidence: $(VENV)/.ready
	$(PYTEST) -m evidence
	$(V)/python -m benchmarks.evidence --stale
	$(V)/python -m benchmarks.cad_random
	$(V)/python -m benchmarks.gel_drags
	$(V)/python -m benchmarks.strangers

clean:
	rm -rf .venv .venv-3.* demo-out site .doctrees .pytest_cache .mypy_cache .ruff_cache .import_linter_cache
