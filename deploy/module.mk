# SPDX-License-Identifier: Apache-2.0
# What a machine needs, the demonstration, and installing.
deps: ## install the Debian packages that are missing (as root or by sudo)
	@sh deploy/deps.sh

deps-full: ## the same with the optional ones: linters, peers for benchmarks, a browser
	@sh deploy/deps.sh --full

# deps may install what the makefile's own recipes need, so the rest runs in a fresh make.
demo: deps ## build, bake a city, serve it, query it, draw it: two minutes
	@$(MAKE) --no-print-directory -j$(CORES) all $(BUILD)/scenegen
	@BUILD=$(BUILD) sh deploy/demo.sh

bindir ?= $(PREFIX)/bin
libdir ?= $(PREFIX)/lib
includedir ?= $(PREFIX)/include
docdir ?= $(PREFIX)/share/doc/umbrage

install: all ## install programs, libraries and headers under DESTDIR and PREFIX
	install -d $(DESTDIR)$(bindir) $(DESTDIR)$(libdir) $(DESTDIR)$(includedir)/umbrage $(DESTDIR)$(docdir)
	install -m 0755 $(BUILD)/umbrage $(BUILD)/umbraged $(BUILD)/umbrage-bake $(BUILD)/umbrage-study $(DESTDIR)$(bindir)
	install -m 0644 $(CORE_LIB) $(RPC_LIB) $(WIRE_LIB) $(DESTDIR)$(libdir)
	install -m 0644 client/include/umbrage/*.h $(DESTDIR)$(includedir)/umbrage
	install -m 0644 README.md LICENSE $(wildcard docs/*.md) $(DESTDIR)$(docdir)

.PHONY: deps deps-full demo install
