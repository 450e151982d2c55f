"""What a beam is: basis, grid, section, pose, and its mirror image."""

from curvcasadi.beam.along import Piecewise, Steps
from curvcasadi.beam.basis import (
    Basis as Basis,
    ChannelBasis,
    VectorBasis,
)
from curvcasadi.beam.beam import (
    Beam,
)
from curvcasadi.beam.compliance import (
    ComplianceBasis,
)
from curvcasadi.beam.families import (
    BSpline,
    CantileverModes,
    Chebyshev,
    Family as Family,
    FreeTip,
    Legendre,
    Monomial,
    PiecewiseConstant,
    Tabulated,
)
from curvcasadi.beam.geometry import WingGeometry, wing_root
from curvcasadi.beam.grid import ElementRule as ElementRule, Grid
from curvcasadi.beam.mirror import (
    mirror,
)
from curvcasadi.beam.modal import (
    ModalBasis,
    Modes,
)
from curvcasadi.beam.perturbed import perturbed_beam
from curvcasadi.beam.pose import (
    Pose,
)
from curvcasadi.beam.section import (
    Body,
    Section,
    condense_axial,
)
from curvcasadi.beam.section_table import Condensation, SectionTable

__all__ = [
    "BSpline",
    "Beam",
    "Body",
    "CantileverModes",
    "ChannelBasis",
    "Chebyshev",
    "ComplianceBasis",
    "Condensation",
    "FreeTip",
    "Grid",
    "Legendre",
    "ModalBasis",
    "Modes",
    "Monomial",
    "Piecewise",
    "PiecewiseConstant",
    "Pose",
    "Section",
    "SectionTable",
    "Steps",
    "Tabulated",
    "VectorBasis",
    "WingGeometry",
    "condense_axial",
    "mirror",
    "perturbed_beam",
    "wing_root",
]
