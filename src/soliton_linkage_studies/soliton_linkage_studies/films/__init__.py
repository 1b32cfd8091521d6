# SPDX-License-Identifier: Apache-2.0
"""Films of the motions of the paper.

To add a kind of film, write a module here with a scene that has the decorator `scenes.film_kind`,
a film of this kind in the settings file, and a test.
"""
