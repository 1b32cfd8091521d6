# SPDX-License-Identifier: Apache-2.0
SHELL := /bin/bash
SCENARIO ?= flipper
scenarios := $(filter-out linkage,$(basename $(notdir $(wildcard config/*.yaml))))
enter := . setup/environment.sh && exec

.NOTPARALLEL:
.PHONY: help demo live test test-interfaces check shell figures films sweep collisions accuracy active waves contraction moves camera driving benchmark format build build-demo develop clean scenario soak audit release

help:  ## list the targets
	@echo 'make demo [SCENARIO=flipper]  run an experiment ($(scenarios))'
	@sed -n 's/^\([a-z-]*\):.*## /make \1\t/p' Makefile | expand -t 30

demo: scenario $(if $(filter filmed%,$(SCENARIO)),build develop,build-demo)
	@$(enter) experiment config/$(SCENARIO).yaml --output out/demo --page

live: scenario build-demo  ## a chain in the browser to push, move and record; SCENARIO=spinner, LESSON=1
	@$(enter) live config/$(SCENARIO).yaml --output out/live $(if $(LESSON),--lesson) $(ARGS)

# More at a time than there are cores: tests of nodes mostly wait.
test: build develop  ## run the tests side by side; ARGS='-k nudge' goes to pytest instead
	@$(enter) python3 -m pytest $(or $(ARGS),--numprocesses $$(($$(nproc) + 4)) --dist worksteal)

test-interfaces: build develop  ## the tests of services, with substitutes for the standard packages
	@setup/interfaces.sh

check: build develop  ## formatting, lint, unsafe calls, strict typing and pinned versions
	@. setup/environment.sh && ruff format --check . && ruff check . && \
	    mypy --python-executable $$(ls .python/typing/bin/python3 2>/dev/null || command -v python3) && \
	    python3 setup/pins.py

audit: build  ## ask the database of known vulnerabilities about the pinned packages
	@$(enter) setup/audit.sh $(ARGS)

release: build  ## build wheels and source archives twice, and keep them where they are the same
	@$(enter) python3 setup/release.py

shell: build  ## a shell where the nodes start by their name
	@setup/shell.sh

.PHONY: docs
docs: build  ## build the documentation into out/docs
	@$(enter) setup/docs.sh

figures: build  ## draw the figures of the paper and its table into out/figures; ARGS='--quick'
	@$(enter) soliton-linkage figures --output out/figures $(ARGS)

films: build  ## film the motions of the paper into out/films; ARGS='--quick'
	@$(enter) soliton-linkage films --output out/films $(ARGS)

sweep: build  ## sweep parameters, by default the phase diagram; ARGS='config/studies/... --quick'
	@$(enter) soliton-linkage sweep $(ARGS)

collisions: build  ## collide kinks and anti-kinks at many speeds; ARGS='--quick'
	@$(enter) soliton-linkage collisions --output out/collisions $(ARGS)

accuracy: build  ## compare the errors of the estimators with their bound and with the stated deviations; ARGS='--quick'
	@$(enter) soliton-linkage accuracy --output out/accuracy $(ARGS)

contraction: build  ## record walls at a dozen speeds and measure how they contract; ARGS='--quick'
	@$(enter) contraction --output out/contraction $(ARGS)

moves: build  ## move solitons to positions on simulated chains; ARGS='--quick'
	@$(enter) soliton-linkage moves --output out/moves $(ARGS)

camera: build develop  ## measure the angles in rendered films by a camera, and compare them with the true angles; ARGS='--quick'
	@$(enter) soliton-linkage camera --output out/camera $(ARGS)

active: build  ## show walls that motors move by non-reciprocal coupling, with their theory
	@$(enter) soliton-linkage active --output out/active $(ARGS)

waves: build  ## show wave packets that move and create walls
	@$(enter) soliton-linkage waves --output out/waves $(ARGS)

driving: build  ## show on one page what drives a chain: actuator, energy balance, bars, tilt, moves
	@$(enter) soliton-linkage driving --output out/driving $(ARGS)

benchmark: build develop  ## compare the speed with other tools; ONLY=publish; ARGS='--quick'
	@$(enter) setup/benchmark.sh $(or $(ONLY),all) $(ARGS)

soak: build develop  ## run the whole suite for an hour, killing a node each minute; ARGS='--minutes 5'
	@$(enter) python3 benchmark/soak.py $(ARGS)

fuzz: build develop  ## feed damaged bags and messages to the code that reads them; ARGS='--minutes 60'
	@$(enter) python3 test/fuzz/fuzz.py $(ARGS)

format: build develop  ## format the code
	@. setup/environment.sh && ruff format . && ruff check --fix .

build:  ## install and build, as every target above does first
	@setup/install.sh && setup/build.sh

build-demo:  # without the loops that only identification, vision and studies use
	@setup/install.sh && setup/build.sh demo

develop:  # what tests and checks need
	@setup/install.sh development

clean:  ## remove what was installed and built; recordings in out/ stay
	rm -rf .python .venv build install log

scenario:
	@test -f config/$(SCENARIO).yaml || { echo >&2 \
	    "SCENARIO=$(SCENARIO): no config/$(SCENARIO).yaml; there are: $(scenarios)"; exit 1; }
