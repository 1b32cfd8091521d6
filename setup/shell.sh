#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Opens a shell with the workspace sourced; input that is not a terminal is run in it.
cd "$(dirname "${BASH_SOURCE[0]}")/.." || exit 1
unset MAKEFLAGS MAKELEVEL MFLAGS
. setup/environment.sh || exit 1
[ -t 0 ] || exec bash

nodes=(install/lib/soliton_linkage_nodes/*)
printf 'These start by their name, with --ros-args for parameters and remappings; exit leaves.\n'
printf 'soliton-linkage runs the studies, and shows topics, parameters and services.\n'
printf '    %s\n' "${nodes[@]##*/}"
export VIRTUAL_ENV_DISABLE_PROMPT=1
# The person's own settings first: what they put on the path must not come before ours.
bash --rcfile <(echo '
    [ ! -f ~/.bashrc ] || . ~/.bashrc
    . setup/environment.sh
    eval "$(register-python-argcomplete soliton-linkage 2>/dev/null)"
    PS1="(soliton_linkage) $PS1"') || true
