# SPDX-License-Identifier: Apache-2.0
"""What free motion shows: masses, stiffnesses, drag and gravity, of springs and of bars."""
