#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# with_threads.sh PROGRAM...: names those that can have more than one thread: they import a function
# that starts threads. TSan has nothing to see in the others.
for program in "$@"; do
    nm -D --undefined-only "$program" | grep -qE '(pthread_create|thrd_create|uv_thread_create|uv_queue_work|rtcNewDevice)' &&
        echo "$program"
done
exit 0
