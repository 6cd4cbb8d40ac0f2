# FootFall: `make run` starts it, `make test` tests it. `make` alone lists all targets.

.DEFAULT_GOAL := help
.SUFFIXES:
MAKEFLAGS += --no-print-directory

CONSOLE_SOURCES := $(shell find web/src web/public web/index.html web/vite.config.ts \
	web/tsconfig.json -type f 2>/dev/null)
MCAP_PYTHON := 1.6.0
VENV := target/venv

.PHONY: help run console test check bench soak format tools packages

help: ## List the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-8s %s\n", $$1, $$2 }' Makefile

run: tools console ## Build all and start the ground server with the simulated rover
	@cargo build --release --locked -p server
	@target/release/footfall serve --demo

console: web/dist/index.html ## Build the console

web/node_modules/.package-lock.json: web/package.json web/package-lock.json | tools
	@cd web && npm ci --no-fund --no-audit
	@touch $@

web/dist/index.html: web/node_modules/.package-lock.json $(CONSOLE_SOURCES)
	@cd web && npm run build
	@touch $@

tools:
	@.ci/tools.sh

packages:
	@.ci/packages.sh

$(VENV)/mcap-$(MCAP_PYTHON): | packages
	@rm -rf $(VENV)
	@python3 -m venv $(VENV)
	@$(VENV)/bin/pip install --quiet --disable-pip-version-check mcap==$(MCAP_PYTHON)
	@touch $@

test: tools packages console $(VENV)/mcap-$(MCAP_PYTHON) ## Run all tests, those in a browser included
	@rm -f target/skipped-tests.txt
	FOOTFALL_PYTHON=$(CURDIR)/$(VENV)/bin/python cargo test --workspace --locked
	cd web && npm test
	cd web && CHROMIUM="$${CHROMIUM:-$$(command -v chromium)}" npm run e2e
	@if [ -s target/skipped-tests.txt ]; then \
		sort -u target/skipped-tests.txt; \
		echo "All tests passed; $$(sort -u target/skipped-tests.txt | wc -l) were skipped, as listed above."; \
	else \
		echo "All tests passed; none was skipped."; \
	fi

check: tools web/node_modules/.package-lock.json ## Format, lints, types, documents
	cargo fmt --all --check
	cargo clippy --workspace --all-targets --locked -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --locked --quiet
	cd web && npm run check
	node .ci/check-docs.mjs
	@echo "All checks passed."

bench: tools ## Run all benchmarks and print one table (FOOTFALL_BENCH_GB: size of the log that is searched, 0.2)
	cargo bench --workspace --locked --bench '*'
	@node .ci/bench-table.mjs

# At most half an hour on two cores. Times printed are worth something where nothing else runs.
soak: tools web/node_modules/.package-lock.json $(VENV)/mcap-$(MCAP_PYTHON) ## Run 10^5 generated requests, and the long forms of tests by brute force
	@FOOTFALL_PYTHON=$(CURDIR)/$(VENV)/bin/python node .ci/soak.mjs

format: tools web/node_modules/.package-lock.json ## Format all sources
	cargo fmt --all
	cd web && npx --no-install prettier --write . >/dev/null
