# Everything runs in .venv, which `setup` makes; stamp files keep it from being made twice.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMPS := $(VENV)/stamps
ENGINE := $(shell find crates -name '*.rs' -o -name 'Cargo.toml') Cargo.toml Cargo.lock pyproject.toml python/quasirigid/_quasirigid.pyi
RESULT ?= out/grasp
# Property tests try the same cases in every run of `make test`; `make fuzz` tries new ones, ROUNDS times as many.
SEED ?= 1
ROUNDS ?= 20
# Spoilt files and odd calls follow from this number; a finding names it.
FUZZ_SEED ?= $(shell date +%s)

.DEFAULT_GOAL := help
.PHONY: help setup webxr-tools grasp view test test-rust test-python lint fuzz audit bench clean

help: ## Show this list.
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | awk -F ':.*## ' '{ printf "  make %-12s %s\n", $$1, $$2 }'

setup: $(STAMPS)/engine ## Make .venv and build the engine in release.

grasp: setup ## Run the main job; files go to out/grasp.
	$(BIN)/quasirigid grasp --out $(RESULT)

view: setup ## Grasp in the browser: http://localhost:8080.
	$(BIN)/quasirigid view

test: lint test-rust test-python ## Check format and types, run all tests.

lint: setup
	cargo fmt --all --check
	cargo clippy --workspace --all-targets --locked -- -D warnings
	$(BIN)/ruff format --check python benchmarks tools
	$(BIN)/ruff check python benchmarks tools
	$(BIN)/mypy
	$(BIN)/mdformat --check *.md docs

test-rust: ## Run the Rust tests.
	PROPTEST_RNG_SEED=$(SEED) cargo test --workspace --locked

test-python: setup ## Run the Python tests.
	$(BIN)/pytest --hypothesis-profile=ci -m "not realtime" --numprocesses auto --maxprocesses 4 --dist loadfile --durations 20
	$(BIN)/pytest --hypothesis-profile=ci -m realtime --durations 10

fuzz: setup ## Try new cases on the property tests, and many spoilt files: make fuzz ROUNDS=200 FUZZ_SEED=1.
	QUASIRIGID_FUZZ=1 QUASIRIGID_FUZZ_SEED=$(FUZZ_SEED) $(BIN)/pytest -rA python/tests/fuzz
	QUASIRIGID_WORLDS=1000 PROPTEST_RNG_SEED=$(FUZZ_SEED) cargo test --locked --release -p quasirigid --test any_world restored
	for round in $$(seq $(ROUNDS)); do \
		cargo test --workspace --locked --release --lib --test any_world --test snapshot_bytes --test sphere_tree --test dtrack_round_trip --quiet || exit 1; \
	done
	$(BIN)/pytest --hypothesis-profile=default $$(grep -l hypothesis python/tests/*.py)

webxr-tools: ## Install what the WebXR page is tested with and built from (needs npm).
	cd tools/webxr && npm ci --no-audit --no-fund

audit: $(STAMPS)/audit ## Look for known flaws in crates and packages, and at their licenses (needs cargo-deny).
	$(VENV)/audit/bin/python tools/audit/audit.py

bench: ## Run the Rust benchmarks.
	cargo bench --workspace --locked

clean: ## Remove everything that was built.
	rm -rf $(VENV) target out python/quasirigid/*.so

$(STAMPS)/venv: requirements.lock
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10) and "quasirigid needs Python 3.10 or newer")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	mkdir -p $(STAMPS) && touch $@

$(STAMPS)/audit: tools/audit/requirements.lock
	$(PYTHON) -m venv $(VENV)/audit
	$(VENV)/audit/bin/pip install --quiet --disable-pip-version-check --require-hashes -r tools/audit/requirements.lock
	mkdir -p $(STAMPS) && touch $@

$(STAMPS)/engine: $(STAMPS)/venv $(ENGINE)
	VIRTUAL_ENV=$(abspath $(VENV)) $(BIN)/maturin develop --release --locked --quiet
	touch $@
