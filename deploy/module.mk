# SPDX-License-Identifier: Apache-2.0
# Targets that install packages a machine needs, run the demonstration, install umbrage, and make
# releases.
deps: ## install the Debian packages that are missing (as root or by sudo)
	@sh deploy/deps.sh

deps-full: ## the same with the optional ones: linters, peers for benchmarks, a browser
	@sh deploy/deps.sh --full

# deps may install what the makefile's own recipes need, so the rest runs in a fresh make.
demo: deps ## build, bake a city, serve it, query it, draw it: two minutes
	@$(MAKE) --no-print-directory -j$(CORES) all $(BUILD)/scenegen
	@BUILD=$(BUILD) sh deploy/demo.sh

view: ## open the city of `make demo` in the browser, or VIEW="ASSET --scene SCENE"
	@sh deploy/deps.sh --view
	@$(MAKE) --no-print-directory -j$(CORES) $(BUILD)/umbrage web
	@$(BUILD)/umbrage view $(or $(VIEW),demo-out/city.umb --scene demo-out/city.glb)

container: ## the container image (IMAGE=umbrage, a newer BASE_DIGEST=sha256:...; podman, or BUILDER=docker)
	@sh deploy/container.sh "$(BASE_DIGEST)" "$(or $(IMAGE),umbrage)"

bindir ?= $(PREFIX)/bin
libdir ?= $(PREFIX)/lib
pkgconfigdir ?= $(libdir)/pkgconfig
includedir ?= $(PREFIX)/include
mandir ?= $(PREFIX)/share/man
bashcompdir ?= $(PREFIX)/share/bash-completion/completions
zshcompdir ?= $(PREFIX)/share/zsh/site-functions
fishcompdir ?= $(PREFIX)/share/fish/vendor_completions.d
docdir ?= $(PREFIX)/share/doc/umbrage
datadir ?= $(PREFIX)/share/umbrage
pythondir ?= $(PREFIX)/lib/python3/dist-packages
unitdir ?= $(PREFIX)/lib/systemd/system
sysusersdir ?= $(PREFIX)/lib/sysusers.d
tmpfilesdir ?= $(PREFIX)/lib/tmpfiles.d
sysconfdir ?= $(if $(filter /usr,$(PREFIX)),/etc,$(PREFIX)/etc)

MAN_PAGES := $(patsubst deploy/man/%.in,$(BUILD)/man/%,$(wildcard deploy/man/*.in))
UNIT := $(BUILD)/systemd/umbraged.service

# The man pages quote what the programs print, so the programs are built first.
$(MAN_PAGES): $(BUILD)/man/%: deploy/man/%.in deploy/man/man.sh $(addprefix $(BUILD)/,umbrage umbraged umbrage-bake umbrage-study)
	@mkdir -p $(@D)
	$(call say,MAN,$@)
	$(Q)BUILD=$(BUILD) sh deploy/man/man.sh <$< >$@

man: $(MAN_PAGES) ## the manual pages

# Shell completions of the four programs, from their tables of options.
COMPLETIONS := $(addprefix $(BUILD)/completion/umbrage.,bash zsh fish)
$(BUILD)/completion/options: $(addprefix $(BUILD)/,umbrage umbraged umbrage-bake umbrage-study)
	@mkdir -p $(@D)
	$(Q)for program in $^; do $$program --print-options || exit 1; done >$@
$(COMPLETIONS): $(BUILD)/completion/umbrage.%: $(BUILD)/completion/options deploy/completion/completion.awk
	$(call say,GEN,$@)
	$(Q)awk -v shell=$* -f deploy/completion/completion.awk <$< >$@

completions: $(COMPLETIONS) ## the completions of bash, zsh and fish

# The systemd unit contains paths of the installation, which each call of make may change, so it is
# made anew each time.
$(UNIT): deploy/systemd/umbraged.service.in FORCE
	@mkdir -p $(@D)
	$(Q)sed -e 's|@bindir@|$(bindir)|; s|@sysconfdir@|$(sysconfdir)|' $< >$@

# The pages are installed in the same folders as in the source tree, with all files that they link
# to, so that every link works.
DOC_FILES = README.md SECURITY.md LICENSE $(wildcard docs/*.md docs/*/* proto/umbrage/v1/*.proto client/include/umbrage/*.h)
install-docs:
	for file in $(DOC_FILES); do install -D -m 0644 $$file $(DESTDIR)$(docdir)/$$file || exit 1; done

# The .pc files give folders relative to their own, so that an installation that is moved as a whole
# still works.
below = $(shell realpath -m --relative-to=$(1) $(2))
install-libraries: libraries ## install headers, libraries and .pc files under DESTDIR and PREFIX
	install -d $(DESTDIR)$(libdir) $(DESTDIR)$(pkgconfigdir) $(DESTDIR)$(includedir)/umbrage
	install -m 0644 client/include/umbrage/*.h $(DESTDIR)$(includedir)/umbrage
	install -m 0644 $(CORE_LIB) $(MAPS_LIB) $(RPC_LIB) $(SHARED_LIBS) $(DESTDIR)$(libdir)
	for lib in $(notdir $(SHARED_LIBS)); do ln -sf $$lib $(DESTDIR)$(libdir)/$${lib%.$(SONAME)} || exit 1; done
	for name in $(EXPORTS); do sed -e 's|@prefix@|$(call below,$(pkgconfigdir),$(PREFIX))|; s|@libdir@|$(call below,$(PREFIX),$(libdir))|' \
		-e 's|@includedir@|$(call below,$(PREFIX),$(includedir))|; s|@version@|$(VERSION)|' client/pkgconfig/$$name.pc.in \
		>$(DESTDIR)$(pkgconfigdir)/$$name.pc || exit 1; done

install-python: python ## install the Python module under DESTDIR and pythondir
	install -d $(DESTDIR)$(pythondir)/umbrage
	install -m 0644 $(PYTHON_OUT) $(PYTHON_DIR)/_declarations.py $(DESTDIR)$(pythondir)/umbrage

install: all gpu web-if-here man completions $(UNIT) install-docs install-libraries ## install everything under DESTDIR and PREFIX
	install -d $(DESTDIR)$(bindir)
	install -m 0755 $(BUILD)/umbrage $(BUILD)/umbraged $(BUILD)/umbrage-bake $(BUILD)/umbrage-study $(DESTDIR)$(bindir)
	for page in $(MAN_PAGES); do install -D -m 0644 $$page $(DESTDIR)$(mandir)/man$${page##*.}/$${page##*/} || exit 1; done
	install -D -m 0644 $(BUILD)/completion/umbrage.bash $(DESTDIR)$(bashcompdir)/umbrage
	install -D -m 0644 $(BUILD)/completion/umbrage.zsh $(DESTDIR)$(zshcompdir)/_umbrage
	install -D -m 0644 $(BUILD)/completion/umbrage.fish $(DESTDIR)$(fishcompdir)/umbrage.fish
	for name in umbraged umbrage-bake umbrage-study; do ln -sf umbrage $(DESTDIR)$(bashcompdir)/$$name && \
		ln -sf umbrage.fish $(DESTDIR)$(fishcompdir)/$$name.fish || exit 1; done
	install -D -m 0644 $(UNIT) $(DESTDIR)$(unitdir)/umbraged.service
	install -D -m 0644 deploy/systemd/umbraged.socket $(DESTDIR)$(unitdir)/umbraged.socket
	install -D -m 0644 deploy/systemd/umbrage.sysusers $(DESTDIR)$(sysusersdir)/umbrage.conf
	install -D -m 0644 deploy/systemd/umbrage.tmpfiles $(DESTDIR)$(tmpfilesdir)/umbrage.conf
	install -d $(DESTDIR)$(datadir)
	install -m 0644 deploy/haproxy/haproxy.cfg deploy/nginx/umbrage-assets.conf deploy/caddy/Caddyfile deploy/prometheus/umbrage.yml deploy/prometheus/umbrage-alerts.yml deploy/grafana/umbrage.json deploy/systemd/umbraged-jobs.conf $(DESTDIR)$(datadir)
	for file in $(wildcard proto/umbrage/v1/*.proto); do install -D -m 0644 $$file $(DESTDIR)$(datadir)/$$file || exit 1; done
	install -d $(DESTDIR)$(datadir)/slurm $(DESTDIR)$(datadir)/gpu
	install -m 0644 $(GPU_FILES) $(DESTDIR)$(datadir)/gpu
	if test -e $(WEB_PACKAGE)/umbrage.wasm; then install -d $(DESTDIR)$(datadir)/web/umbrage $(DESTDIR)$(datadir)/web/viewer && \
		install -m 0644 $(WEB_PACKAGE)/* $(DESTDIR)$(datadir)/web/umbrage && install -m 0644 $(VIEWER_FILES) $(DESTDIR)$(datadir)/web/viewer; fi
	install -m 0755 deploy/slurm/two-nodes.sh $(DESTDIR)$(datadir)/slurm
	install -d $(DESTDIR)$(sysconfdir)/umbraged
	test -e $(DESTDIR)$(sysconfdir)/umbraged/umbraged.conf || install -m 0644 deploy/umbraged.conf $(DESTDIR)$(sysconfdir)/umbraged/umbraged.conf

# Archives and packages of a release are made from the last commit; the times of their files are the
# commit's.
NAMED := umbrage-$(VERSION)
dist: ## source archive of the last commit: the same bytes on every machine
	@mkdir -p $(BUILD)/dist
	$(call say,TAR,$(BUILD)/dist/$(NAMED).tar.gz)
	$(Q)git -c tar.umask=0022 archive --format=tar --prefix=$(NAMED)/ HEAD | gzip -9n >$(BUILD)/dist/$(NAMED).tar.gz

deb: dist ## Debian packages of the last commit, in BUILD/deb (debhelper, dh-python)
	@BUILD=$(BUILD) sh deploy/deb.sh $(VERSION)

sbom: dist $(PROGRAMS) $(SHARED_LIBS) ## bill of materials (SPDX 2.3) of programs and libraries, in BUILD/dist
	$(Q)/usr/bin/python3 deploy/sbom.py $(VERSION) $(BUILD)/dist/$(NAMED).tar.gz $(BUILD)/dist/$(NAMED).spdx.json $(PROGRAMS) $(SHARED_LIBS)

version: ## set the version of the tree (VERSION=1.2.3 DATE=2026-01-31), see docs/CONTRIBUTING.md
	@deploy/version.py "$(if $(filter command,$(origin VERSION)),$(VERSION))" $(DATE)

# The wheel is of the objects of the packages, the bill of materials of the programs and libraries in them.
DEB_TREE = $(BUILD)/deb/$(NAMED)
release: ## everything of a release in BUILD/dist: source archive, packages, wheel, bill of materials, SHA256SUMS
	@git diff --quiet HEAD || { echo "release: files differ from the last commit, which a release is made of; commit them" >&2; exit 1; }
	$(Q)rm -rf $(BUILD)/dist
	@$(MAKE) --no-print-directory deb
	$(Q)export SOURCE_DATE_EPOCH=$$(git log -1 --format=%ct) && \
		env -u MAKEFLAGS -u CC $(MAKE) --no-print-directory -C $(DEB_TREE) BUILD=build/release NANOVDB= wheel && \
		cp $(DEB_TREE)/build/release/dist/*.whl $(BUILD)/deb/*.deb $(BUILD)/dist && \
		/usr/bin/python3 deploy/sbom.py $(VERSION) $(BUILD)/dist/$(NAMED).tar.gz $(BUILD)/dist/$(NAMED).spdx.json \
			$(DEB_TREE)/debian/umbrage*/usr/bin/* $(DEB_TREE)/debian/libumbrage1/usr/lib/*/*.so.$(SONAME)
	$(Q)cd $(BUILD)/dist && LC_ALL=C && export LC_ALL && sha256sum -- *.* >SHA256SUMS && cat SHA256SUMS
	@if grep -q '^## $(VERSION) (unreleased)' docs/CHANGELOG.md; then echo "a trial: docs/CHANGELOG.md says (unreleased)"; \
		else test -d tests/compat/$(VERSION) || echo "tests/compat/$(VERSION) is missing: make compat-record"; \
		echo "the tag: git tag -a v$(VERSION) -m 'umbrage $(VERSION)' $$(git rev-parse --short HEAD)"; fi

FORCE:

.PHONY: sbom version release dist deb install-python completions container deps deps-full demo view man install install-docs install-libraries FORCE
