# SPDX-License-Identifier: Apache-2.0
"""Films of the motions of the paper.

To add a kind of film, write a module in this package whose scene has the decorator
`scenes.FILM_KINDS.add`. Then add a film of this kind to the settings file, and write a test.
"""
