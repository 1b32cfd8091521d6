# SPDX-License-Identifier: Apache-2.0

from soliton_linkage.estimation.analyser import Analyser as Analyser
from soliton_linkage.estimation.analysis import Analysis as Analysis
from soliton_linkage.estimation.analysis import UnknownChainAnalyser as UnknownChainAnalyser
from soliton_linkage.estimation.estimates import EventKind as EventKind
from soliton_linkage.estimation.estimates import OrbitEstimate as OrbitEstimate
from soliton_linkage.estimation.estimates import SolitonEvent as SolitonEvent
from soliton_linkage.estimation.motion_class import MotionClass as MotionClass
from soliton_linkage.estimation.motion_class import MotionObserver as MotionObserver
from soliton_linkage.estimation.orbit_filter import OrbitFilter as OrbitFilter
from soliton_linkage.estimation.relocalisation import NearestPoint as NearestPoint
from soliton_linkage.estimation.relocalisation import fit_anywhere as fit_anywhere
from soliton_linkage.estimation.relocalisation import fit_near as fit_near
from soliton_linkage.estimation.settings import EstimationSettings as EstimationSettings
