# make demo   environment, install, the main job; ends with the path of a report page
# make test   environment, install, every test; make test-quick a part of them in a minute, make test-long the long ones too
VENV ?= .venv
BIN := $(VENV)/bin

.PHONY: demo test test-quick test-long test-lowest lint clean
demo: $(VENV)/installed
	$(BIN)/kfgen demo --out out/demo

test: $(VENV)/installed
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist worksteal -m "not long"

test-quick: $(VENV)/installed
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist worksteal -m "quick and not long"

test-long: $(VENV)/installed
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist worksteal

# The lowest versions that are declared, in an environment of their own.
test-lowest:
	sh tools/venv.sh .venv-lowest
	.venv-lowest/bin/python -m pip install -q --disable-pip-version-check pytest hypothesis -e . $$($(BIN)/python tools/lowest.py)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 .venv-lowest/bin/python -m pytest -m "quick and not long"

lint: $(VENV)/installed
	$(BIN)/ruff check . && $(BIN)/ruff format --check . && $(BIN)/mypy && $(BIN)/lint-imports

$(VENV)/installed: pyproject.toml constraints.txt tools/venv.sh
	sh tools/venv.sh $(VENV)
	$(BIN)/python -m pip install -q --disable-pip-version-check -c constraints.txt -e '.[test]'
	touch $@

clean:
	rm -rf $(VENV) .venv-lowest out build dist
