# SPDX-License-Identifier: Apache-2.0
"""The angles that a camera sees in rendered films, against the truth and the pixels' bound."""
