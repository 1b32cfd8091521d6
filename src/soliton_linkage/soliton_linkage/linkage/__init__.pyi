# SPDX-License-Identifier: Apache-2.0

from soliton_linkage.linkage.chain import Chain as Chain
from soliton_linkage.linkage.chain import Motion as Motion
from soliton_linkage.linkage.chain import displacement as displacement
from soliton_linkage.linkage.chain import staggered as staggered
from soliton_linkage.linkage.chain import uprightness as uprightness
from soliton_linkage.linkage.chain import wrapped as wrapped
from soliton_linkage.linkage.deviations import Deviations as Deviations
from soliton_linkage.linkage.encoders import EncoderErrors as EncoderErrors
from soliton_linkage.linkage.encoders import Encoders as Encoders
from soliton_linkage.linkage.feedback import Feedback as Feedback
from soliton_linkage.linkage.gravity import Gravity as Gravity
from soliton_linkage.linkage.recording import Recording as Recording
from soliton_linkage.linkage.urdf import JointLimits as JointLimits
from soliton_linkage.linkage.urdf import robot_description as robot_description
