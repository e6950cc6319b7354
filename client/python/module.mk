# SPDX-License-Identifier: Apache-2.0
# The Python module `umbrage` over the shared libraries. Nothing of it is compiled: cffi's tables of the headers are
# text. python3-cffi makes the tables; python3-cffi-backend and python3-numpy are what its users need.
PYTHON_DIR := $(BUILD)/python/umbrage
PYTHON_OUT := $(patsubst client/python/umbrage/%,$(PYTHON_DIR)/%,$(sort $(wildcard client/python/umbrage/*.py client/python/umbrage/py.typed)))
$(PYTHON_OUT): $(PYTHON_DIR)/%: client/python/umbrage/%
	@mkdir -p $(@D)
	$(Q)cp $< $@
$(PYTHON_DIR)/_declarations.py: client/python/declarations.py $(sort $(wildcard client/include/umbrage/*.h))
	@mkdir -p $(@D)
	$(call say,GEN,$@)
	$(Q)CC="$(CC)" /usr/bin/python3 $< $(@D) >/dev/null

# The wheel carries the libraries, umbrage-bake, and what both need beside glibc.
WHEEL_NEEDS := $(WHEEL_LIBS) $(BUILD)/wheel/bin/umbrage-bake
wheel: python $(WHEEL_NEEDS) ## a wheel for pip, in BUILD/dist: module, libraries and umbrage-bake
	$(Q)/usr/bin/python3 deploy/wheel.py $(VERSION) $(PYTHON_DIR) $(BUILD)/wheel $(BUILD)/dist

python: libraries $(PYTHON_OUT) $(PYTHON_DIR)/_declarations.py ## the Python module, in BUILD/python
.PHONY: python wheel
