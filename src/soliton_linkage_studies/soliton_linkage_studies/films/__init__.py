# SPDX-License-Identifier: Apache-2.0
"""The motions of the paper as films.

A new kind of film is a module here whose scene has the decorator `scenes.film_kind`, a film of
that kind in the settings, and its test.
"""
