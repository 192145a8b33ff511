# make demo   environment, install, the main job; ends with the path of a report page
# make docs   environment, the pages as a site with the notebooks executed; ends with the path of its first page
# make test   environment, install, every test; make test-quick a part of them in a minute, make test-long the long
#             ones too, then make prove, whose figures are the tables of docs/trust.md
VENV ?= .venv
BIN := $(VENV)/bin

.PHONY: demo docs test test-quick test-long test-lowest prove lint clean
demo: $(VENV)/installed
	$(BIN)/kfgen demo --out out/demo

docs: $(VENV)/installed-docs
	$(BIN)/python -m sphinx -q -W --keep-going -E -b html -d build/doctrees docs out/docs
	@echo "out/docs/index.html"

test: $(VENV)/installed
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist worksteal -m "not long"

test-quick: $(VENV)/installed
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist worksteal -m "quick and not long"

test-long: $(VENV)/installed-docs
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist worksteal
	$(MAKE) prove

# The lowest versions that are declared, of every extra that is tested, in an environment of their own.
test-lowest:
	sh tools/venv.sh .venv-lowest
	.venv-lowest/bin/python -m pip install -q --disable-pip-version-check pytest pytest-xdist hypothesis allantools pymavlink -e . \
		$$(.venv-lowest/bin/python tools/lowest.py arma fast pil px4 ros zstd hdf5 parquet)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 .venv-lowest/bin/python -m pytest -n 2 --dist worksteal -m "lowest and not long"

# Three hours: hostile inputs, kills, memory, changes of the code; the figures go into docs/trust.md.
prove: $(VENV)/installed
	$(BIN)/python benchmarks/trust/fuzz.py --docs
	$(BIN)/python benchmarks/trust/kills.py --docs
	$(BIN)/python benchmarks/trust/faults.py --docs
	mkdir -p out && $(BIN)/python benchmarks/trust/drawn.py out/drawn.jsonl --minutes 90
	$(BIN)/python benchmarks/trust/nulls.py out/drawn.jsonl --docs
	$(BIN)/python benchmarks/trust/memory.py --docs
	$(BIN)/python benchmarks/trust/mutants.py --docs

lint: $(VENV)/installed
	$(BIN)/ruff check . && $(BIN)/ruff format --check . && $(BIN)/mypy && $(BIN)/lint-imports

$(VENV)/installed: pyproject.toml constraints.txt tools/venv.sh
	sh tools/venv.sh $(VENV)
	$(BIN)/python -m pip install -q --disable-pip-version-check -c constraints.txt -e '.[test]'
	touch $@

$(VENV)/installed-docs: $(VENV)/installed
	$(BIN)/python -m pip install -q --disable-pip-version-check -c constraints.txt -e '.[docs]'
	touch $@

clean:
	rm -rf $(VENV) .venv-lowest out build dist
