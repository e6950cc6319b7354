#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# run.sh TEST...: runs tests side by side and ends with one line "N passed, N failed, N skipped";
# run_tests.py says which variables it takes.
exec /usr/bin/python3 "$(dirname "$0")/run_tests.py" "$@"
