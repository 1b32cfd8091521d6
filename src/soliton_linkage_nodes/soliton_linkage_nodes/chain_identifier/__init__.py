# SPDX-License-Identifier: Apache-2.0
"""The node that proposes a chain of what joints do, and what live and offline work share."""
