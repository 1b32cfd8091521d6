# SPDX-License-Identifier: Apache-2.0
"""Study of walls in chains whose motors couple neighbouring rotors non-reciprocally."""
