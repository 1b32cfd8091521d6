# SPDX-License-Identifier: Apache-2.0
"""Programs that run experiments on simulated chains: figures, films and sweeps."""
