//! Named parts of the mesh: which nodes are fixed, moved or measured.

use std::sync::LazyLock;

use nalgebra::Vector3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use surface_mesh::{ClosestPoints, Surface};

use crate::voxelise::{InsideVotes, PointGrid, check_closed};
use crate::{HexMesh, HexMeshError};

/// A coordinate axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Axis {
    /// The first axis.
    X,
    /// The second axis.
    Y,
    /// The third axis.
    Z,
}

impl Axis {
    /// 0, 1 or 2.
    #[must_use]
    pub const fn index(self) -> usize {
        self as usize
    }
}

/// A part of space that selects the nodes inside it, by their rest positions.
///
/// All bounds are inclusive, with a margin of [`NodeRegion::MARGIN`] element sizes so that a face that goes exactly through nodes
/// selects them whatever the rounding. In a scene file: `{ type = "box", min = [0, 0, 0], max = [1, 1, 1] }`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum NodeRegion {
    /// Nodes in an axis-aligned box.
    Box {
        /// Lower corner.
        min: [f64; 3],
        /// Upper corner.
        max: [f64; 3],
    },
    /// Nodes in a ball.
    Sphere {
        /// Centre of the ball.
        center: [f64; 3],
        /// Radius of the ball.
        radius: f64,
    },
    /// Nodes on a plane across an axis.
    Plane {
        /// The axis across which the plane lies.
        axis: Axis,
        /// Where along it.
        value: f64,
    },
    /// Nodes on the side `normal . x >= offset` of a plane.
    HalfSpace {
        /// Direction into the half space; any length but zero.
        normal: [f64; 3],
        /// `normal . x` of the points on the plane.
        offset: f64,
    },
    /// Nodes inside a closed surface, which is given when selecting.
    Surface,
}

impl NodeRegion {
    /// How far outside, in element sizes, a node still counts as inside.
    pub const MARGIN: f64 = 1e-6;

    /// The nodes in the region, by rising index.
    ///
    /// # Errors
    /// [`HexMeshError::RegionInvalid`], [`HexMeshError::RegionEmpty`] when no node is inside, and
    /// [`HexMeshError::RegionNeedsSurface`] for [`NodeRegion::Surface`].
    pub fn select(&self, mesh: &HexMesh) -> Result<Vec<u32>, HexMeshError> {
        self.check()?;
        if matches!(self, Self::Surface) {
            return Err(HexMeshError::RegionNeedsSurface);
        }
        let margin = Self::MARGIN * mesh.element_size();
        let distance = |node: &Vector3<f64>| self.distance(node);
        let nodes = (0..).zip(mesh.nodes());
        let inside = nodes.filter(|(_, node)| distance(node) <= margin);
        not_empty(inside.map(|(index, _)| index).collect(), mesh, distance)
    }

    /// Like [`NodeRegion::select`], with the surface that [`NodeRegion::Surface`] stands for; other regions ignore it.
    ///
    /// Inside is decided by ray parity as in [`voxelise`](crate::voxelise), without a margin.
    ///
    /// # Errors
    /// As [`NodeRegion::select`], and [`HexMeshError::OpenSurface`] or [`HexMeshError::VertexNotFinite`].
    pub fn select_with_surface(
        &self,
        mesh: &HexMesh,
        surface: &Surface,
    ) -> Result<Vec<u32>, HexMeshError> {
        match self {
            Self::Surface => nodes_inside(mesh, surface),
            _ => self.select(mesh),
        }
    }

    /// Which of these points lie in the region, with the margin of [`NodeRegion::select`] for elements of `element_size`.
    ///
    /// # Errors
    /// [`HexMeshError::RegionInvalid`], and [`HexMeshError::RegionNeedsSurface`] for [`NodeRegion::Surface`].
    pub fn contains(
        &self,
        points: &[Vector3<f64>],
        element_size: f64,
    ) -> Result<Vec<bool>, HexMeshError> {
        self.check()?;
        if matches!(self, Self::Surface) {
            return Err(HexMeshError::RegionNeedsSurface);
        }
        let margin = Self::MARGIN * element_size;
        let inside = points.iter().map(|point| self.distance(point) <= margin);
        Ok(inside.collect())
    }

    fn check(&self) -> Result<(), HexMeshError> {
        match self {
            Self::Box { min, max } => {
                finite("min", min)?;
                finite("max", max)?;
                let inverted = (0..3).find(|&axis| min[axis] > max[axis]);
                inverted.map_or(Ok(()), |axis| {
                    invalid("min", min[axis], "it must not exceed max along any axis")
                })
            }
            Self::Sphere { center, radius } => {
                finite("center", center)?;
                finite("radius", &[*radius])?;
                if *radius < 0.0 {
                    return invalid("radius", *radius, "it must not be negative");
                }
                Ok(())
            }
            Self::Plane { value, .. } => finite("value", &[*value]),
            Self::HalfSpace { normal, offset } => {
                finite("normal", normal)?;
                finite("offset", &[*offset])?;
                if *normal == [0.0; 3] {
                    return invalid("normal", 0.0, "it must have a direction");
                }
                Ok(())
            }
            Self::Surface => Ok(()),
        }
    }

    /// Distance from the region, 0 inside; infinite for a surface, which is not known here.
    fn distance(&self, point: &Vector3<f64>) -> f64 {
        match *self {
            Self::Box { min, max } => {
                let [min, max] = [min, max].map(Vector3::from);
                (point - point.sup(&min).inf(&max)).norm()
            }
            Self::Sphere { center, radius } => {
                ((point - Vector3::from(center)).norm() - radius).max(0.0)
            }
            Self::Plane { axis, value } => (point[axis.index()] - value).abs(),
            Self::HalfSpace { normal, offset } => {
                let normal = Vector3::from(normal);
                ((offset - normal.dot(point)) / normal.norm()).max(0.0)
            }
            Self::Surface => f64::INFINITY,
        }
    }
}

fn invalid(field: &'static str, value: f64, rule: &'static str) -> Result<(), HexMeshError> {
    Err(HexMeshError::RegionInvalid { field, value, rule })
}

fn finite(field: &'static str, values: &[f64]) -> Result<(), HexMeshError> {
    match values.iter().find(|value| !value.is_finite()) {
        Some(&value) => invalid(field, value, "it must be finite"),
        None => Ok(()),
    }
}

/// Refuses an empty selection, and says which node came nearest.
fn not_empty(
    selected: Vec<u32>,
    mesh: &HexMesh,
    distance: impl Fn(&Vector3<f64>) -> f64 + Sync,
) -> Result<Vec<u32>, HexMeshError> {
    if !selected.is_empty() {
        return Ok(selected);
    }
    let (distance, node) = mesh
        .nodes()
        .par_iter()
        .enumerate()
        .map(|(index, node)| (distance(node), index))
        .reduce(
            || (f64::INFINITY, usize::MAX),
            |a, b| if b < a { b } else { a },
        );
    Err(HexMeshError::RegionEmpty {
        node,
        position: mesh.nodes()[node],
        distance,
    })
}

fn nodes_inside(mesh: &HexMesh, surface: &Surface) -> Result<Vec<u32>, HexMeshError> {
    let (vertices, triangles) = (surface.vertices(), surface.triangles());
    check_closed(vertices, triangles)?;
    let grid = node_grid(mesh);
    let votes = InsideVotes::new(&grid, vertices, triangles);
    let point_of = |node: &Vector3<f64>| {
        let [x, y, z] = ((node - grid.first) / grid.spacing)
            .map(|x| x.round() as usize)
            .into();
        (x * grid.counts[1] + y) * grid.counts[2] + z
    };
    let nodes = (0..).zip(mesh.nodes());
    let inside = nodes.filter(|(_, node)| votes.is_inside(point_of(node)));
    let selected = inside.map(|(index, _)| index).collect();
    // Only asked for where nothing was selected.
    let nearest = LazyLock::new(|| ClosestPoints::new(surface));
    not_empty(selected, mesh, |node| nearest.to(node).distance)
}

/// The nodes within `reach` of the triangles of a surface, open or closed, by rising index; there may be none.
///
/// # Errors
/// [`HexMeshError::VertexNotFinite`], and [`HexMeshError::RegionInvalid`] when `reach` is negative or not finite.
pub fn nodes_near(mesh: &HexMesh, surface: &Surface, reach: f64) -> Result<Vec<u32>, HexMeshError> {
    if !(reach.is_finite() && reach >= 0.0) {
        return invalid("reach", reach, "it must be finite and not negative").map(|()| Vec::new());
    }
    let is_finite = |vertex: &Vector3<f64>| vertex.iter().all(|x| x.is_finite());
    if let Some(vertex) = { surface.vertices().iter() }.position(|vertex| !is_finite(vertex)) {
        return Err(HexMeshError::VertexNotFinite { vertex });
    }
    let nearest = ClosestPoints::new(surface);
    let nodes = mesh.nodes().par_iter().enumerate();
    let near = nodes.filter(|(_, node)| nearest.to(node).distance <= reach);
    Ok(near.map(|(index, _)| index as u32).collect())
}

/// The grid on which the nodes of a mesh lie.
fn node_grid(mesh: &HexMesh) -> PointGrid {
    let nothing = Vector3::repeat(f64::INFINITY);
    let nodes = mesh.nodes().iter();
    let (min, max) = nodes.fold((nothing, -nothing), |(min, max), node| {
        (min.inf(node), max.sup(node))
    });
    let spacing = mesh.element_size();
    PointGrid {
        first: min,
        spacing,
        counts: ((max - min) / spacing)
            .map(|x| x.round() as usize + 1)
            .into(),
    }
}
