# For people with make; without it, README has the plain commands.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# A file stays on one core, for what its tests share; the order is that of tests/conftest.py, long files first.
SPREAD := --numprocesses auto --dist loadfile --no-loadscope-reorder

IN_POSTGRES := $(addprefix tests/twin/,belief changesets decisions evidence/test_make.py mirror/test_history.py mirror/vegnett reports/test_finding_list.py reports/test_fleet_status.py review/test_review_api.py)

.PHONY: demo reference docs test slow postgres coverage lint check real sample bench bench-speed bench-mirror bench-export bench-calibration bench-review bench-start bench-fleet bench-live bench-live-faults bench-postgres pictures notebooks soak fuzz clean

$(VENV)/.installed: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable ".[dev]"
	touch $@

demo: $(VENV)/.installed          ## the whole job on the sample, into demo-out/
	$(BIN)/twin demo --out demo-out

test: $(VENV)/.installed          ## the whole suite
	$(BIN)/python -m pytest $(SPREAD)

slow: $(VENV)/.installed          ## what takes many seconds for one fact: kills, full disks, the wheel, calibration from pictures, the paper's notebook, long drives, damaged files
	TWIN_SLOW=1 $(BIN)/python -m pytest $(SPREAD) -m slow

postgres: $(VENV)/.installed      ## the rooms of a store's user (decisions, changes, evidence, belief, reports, mirror, review) with their stores in PostgreSQL
	TWIN_TEST_STORES=postgresql $(BIN)/python -m pytest $(SPREAD) $(IN_POSTGRES)

coverage: $(VENV)/.installed      ## the same, and which lines it runs: half as long again
	$(BIN)/python -m pytest $(SPREAD) --cov --cov-report=term

lint: $(VENV)/.installed          ## style, types and the walls between the packages
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

check: lint test slow

real: $(VENV)/.installed          ## real recordings (../shared/real): errors on KITTI and Argoverse, between key frames, on real speeds and bends
	$(BIN)/python benchmarks/real.py
	$(BIN)/python benchmarks/interpolated.py
	$(BIN)/python benchmarks/real_profiles.py

sample: $(VENV)/.installed        ## makes data/ anew, byte for byte
	$(BIN)/python -m twin.samples.sample data

bench: $(VENV)/.installed         ## errors and ellipses on simulated drives against the bars: methods, lengths, labels, clocks, poses, cameras, 25 drives, motion sensors, whether signs stand, objects on the ground
	$(BIN)/python benchmarks/accuracy.py
	$(BIN)/python benchmarks/accuracy.py --as-stated --seeds 10
	$(BIN)/python benchmarks/paper.py
	$(BIN)/python benchmarks/drifting_labels.py
	$(BIN)/python benchmarks/long_drives.py
	$(BIN)/python benchmarks/association.py --seeds 10 --only-cameras
	$(BIN)/python benchmarks/clocks.py
	$(BIN)/python benchmarks/rough_lenses.py
	$(BIN)/python benchmarks/unstated_poses.py
	$(BIN)/python benchmarks/many_drives.py
	$(BIN)/python benchmarks/vehicle_motion.py
	$(BIN)/python benchmarks/annotate.py
	$(BIN)/python benchmarks/belief.py
	$(BIN)/python benchmarks/ground_objects.py

bench-speed: $(VENV)/.installed   ## single frames against cameratransform, the adjustment of an hour, an ingest step by step, on one core
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/locate.py
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/adjust.py
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/ingest.py

bench-start: $(VENV)/.installed   ## how long each command takes until it says something, against the bars
	$(BIN)/python benchmarks/start.py

bench-mirror: $(VENV)/.installed  ## the mirror against a bare loop over the same pages, as ratios
	$(BIN)/python benchmarks/mirror.py

bench-export: $(VENV)/.installed  ## an export of 100,000 findings against bare writes of the same rows
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/export.py

bench-calibration: $(VENV)/.installed  ## rendered boards and tags through known lenses, against the bars
	$(BIN)/python benchmarks/calibration.py
	$(BIN)/python benchmarks/calibration_diff.py
	$(BIN)/python benchmarks/extrinsics.py

bench-fleet: $(VENV)/.installed   ## matching after one more drive, by how many the store has: time and memory; two workers against one, and 30 kills; twenty minutes
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/fleet.py
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/match_parts.py --drives 200
	$(BIN)/python benchmarks/fleet_workers.py

bench-live: $(VENV)/.installed    ## the live engine: time a frame, memory, positions against the batch, replay; verdicts against a match; three quarters of an hour
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/live.py
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/live_check.py

bench-live-faults: $(VENV)/.installed  ## what fails in a car while it drives, fault by fault, a minute each
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/live_faults.py

bench-postgres: $(VENV)/.installed  ## a store in PostgreSQL against one in SQLite: ingest, match, export; five reviewers at once
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/postgres.py
	$(BIN)/python benchmarks/partitions.py

bench-review: $(VENV)/.installed  ## the review page's first view at 10,000 findings, the server's time for an answer, in Chromium
	$(BIN)/python benchmarks/review.py

reference: $(VENV)/.installed     ## docs/reference anew from the code
	$(BIN)/python tools/make_reference.py

docs: $(VENV)/.installed          ## the documentation as a site, by both builders, into site/
	$(BIN)/python -m pip install --quiet --editable ".[docs]"
	$(BIN)/python tools/site.py

pictures: $(VENV)/.installed      ## the pictures of docs/review.md and of the live map, taken in Chromium
	TWIN_PICTURES=1 $(BIN)/python -m pytest tests/twin/review/test_page_pictures.py tests/twin/live/test_live_pictures.py

notebooks: $(VENV)/.installed     ## runs the notebooks again and keeps what they show
	$(BIN)/jupyter-execute --inplace notebooks/*.ipynb

soak: $(VENV)/.installed          ## a hundred syncs killed at random instants, a thousand histories of sending, and of annotating, a thousand examples of each property
	TWIN_KILLS=100 $(BIN)/python -m pytest tests/twin/mirror/test_kill.py
	TWIN_EXAMPLES=1000 $(BIN)/python -m pytest --numprocesses auto -m hypothesis
	TWIN_HISTORIES=1000 $(BIN)/python -m pytest --numprocesses auto tests/twin/changesets/test_histories.py tests/twin/matching/test_renumbered.py tests/twin/matching/test_kept.py

FUZZ := tests/fuzz/test_fuzz_tracks.py $(filter-out %_tracks.py,$(wildcard tests/fuzz/test_fuzz_*.py))
.PHONY: $(FUZZ)
fuzz: $(VENV)/.installed          ## 100,000 damaged files for every parser, two test files at a time
	$(MAKE) --jobs 2 --keep-going --output-sync $(FUZZ)

$(FUZZ):
	TWIN_SLOW=1 TWIN_FUZZ_EXAMPLES=$${TWIN_FUZZ_EXAMPLES:-100000} OMP_NUM_THREADS=1 $(BIN)/python -m pytest $@ -q -rP --show-capture=stdout

clean:
	rm -rf $(VENV) demo-out build dist .coverage
