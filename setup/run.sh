# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
# To be sourced in bash: `run COMMAND` is COMMAND, but Ctrl-C ends it and its children at once.

run() {
    set -m  # gives the command a process group of its own
    "$@" </dev/null &
    set +m
    group=$!
    trap 'kill -TERM -- "-$group" 2>/dev/null; exit 130' HUP INT TERM
    wait "$group"
}
