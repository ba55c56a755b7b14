//! The polygon surface: vertex positions plus a topology that is checked once and shared between poses.

use std::sync::Arc;

use nalgebra::Vector3;

use crate::SurfaceError;

/// A polygon surface. Polygons keep the corners they were given (quads stay quads) and a fan triangulation is kept beside them.
///
/// A surface has at least one vertex and one polygon, its corners are in range, and every polygon has three corners or more.
/// Vertex order is never changed and unused vertices are never dropped, because blendshapes correspond by vertex index.
/// The topology is shared: a clone or [`Surface::with_vertices`] copies positions only.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    vertices: Vec<Vector3<f64>>,
    topology: Arc<Topology>,
}

#[derive(Debug, PartialEq)]
struct Topology {
    corners: Vec<u32>,
    /// Polygon `i` has the corners `corners[offsets[i]..offsets[i + 1]]`.
    offsets: Vec<u32>,
    triangles: Vec<[u32; 3]>,
}

impl Surface {
    /// Builds a surface of triangles.
    ///
    /// # Errors
    /// [`SurfaceError::NoVertices`], [`SurfaceError::NoPolygons`], [`SurfaceError::NonFiniteVertex`],
    /// [`SurfaceError::IndexOutOfRange`] or [`SurfaceError::TooLarge`].
    pub fn from_triangles(
        vertices: Vec<Vector3<f64>>,
        triangles: Vec<[u32; 3]>,
    ) -> Result<Self, SurfaceError> {
        let corner_count = index_count(triangles.len().saturating_mul(3))?;
        let topology = Topology {
            corners: triangles.iter().flatten().copied().collect(),
            offsets: (0..=corner_count).step_by(3).collect(),
            triangles,
        };
        Self::checked(vertices, topology)
    }

    /// Builds a surface of polygons, each listing three corners or more, counter-clockwise seen from outside.
    ///
    /// # Errors
    /// As [`Surface::from_triangles`], and [`SurfaceError::TooFewCorners`].
    pub fn from_polygons(
        vertices: Vec<Vector3<f64>>,
        polygons: Vec<Vec<u32>>,
    ) -> Result<Self, SurfaceError> {
        let mut corners = Vec::new();
        let mut offsets = vec![0];
        for polygon in &polygons {
            corners.extend_from_slice(polygon);
            offsets.push(index_count(corners.len())?);
        }
        Self::from_corners(vertices, corners, offsets)
    }

    /// Builds a surface from concatenated corners; polygon `i` has the corners `corners[offsets[i]..offsets[i + 1]]`.
    ///
    /// # Errors
    /// As [`Surface::from_polygons`].
    ///
    /// # Panics
    /// When `offsets` does not start at 0, decreases, or does not end at `corners.len()`.
    pub fn from_corners(
        vertices: Vec<Vector3<f64>>,
        corners: Vec<u32>,
        offsets: Vec<u32>,
    ) -> Result<Self, SurfaceError> {
        index_count(corners.len())?;
        assert!(
            offsets.first() == Some(&0)
                && offsets.is_sorted()
                && offsets.last().map(|&end| end as usize) == Some(corners.len()),
            "polygon offsets must rise from 0 to the number of corners"
        );
        if let Some(polygon) = offsets.windows(2).position(|ends| ends[1] - ends[0] < 3) {
            let corners = (offsets[polygon + 1] - offsets[polygon]) as usize;
            return Err(SurfaceError::TooFewCorners { polygon, corners });
        }
        let triangles = fan_triangulation(&corners, &offsets);
        let topology = Topology {
            corners,
            offsets,
            triangles,
        };
        Self::checked(vertices, topology)
    }

    fn checked(vertices: Vec<Vector3<f64>>, topology: Topology) -> Result<Self, SurfaceError> {
        if vertices.is_empty() {
            return Err(SurfaceError::NoVertices);
        }
        if topology.triangles.is_empty() {
            return Err(SurfaceError::NoPolygons);
        }
        let vertex_count = index_count(vertices.len())?;
        check_finite(&vertices)?;
        if let Some(corner) = topology.corners.iter().position(|&c| c >= vertex_count) {
            return Err(SurfaceError::IndexOutOfRange {
                polygon: topology.offsets.partition_point(|&o| o as usize <= corner) - 1,
                index: topology.corners[corner],
                vertices: vertices.len(),
            });
        }
        Ok(Self {
            vertices,
            topology: Arc::new(topology),
        })
    }

    /// The same polygons over other vertex positions. The topology is shared, not copied.
    ///
    /// # Errors
    /// [`SurfaceError::VertexCount`] when the number of vertices differs, [`SurfaceError::NonFiniteVertex`].
    pub fn with_vertices(&self, vertices: Vec<Vector3<f64>>) -> Result<Self, SurfaceError> {
        if vertices.len() != self.vertices.len() {
            return Err(SurfaceError::VertexCount {
                expected: self.vertices.len(),
                found: vertices.len(),
            });
        }
        check_finite(&vertices)?;
        Ok(Self {
            vertices,
            topology: Arc::clone(&self.topology),
        })
    }

    /// Vertex positions, in scene length units.
    pub fn vertices(&self) -> &[Vector3<f64>] {
        &self.vertices
    }

    /// Vertex positions, to be moved in place. The caller keeps them finite; [`Surface::with_vertices`] checks.
    pub fn vertices_mut(&mut self) -> &mut [Vector3<f64>] {
        &mut self.vertices
    }

    /// The number of vertices, used or not.
    pub fn vertex_count(&self) -> usize {
        self.vertices.len()
    }

    /// The corners of every polygon, in file order.
    pub fn polygons(&self) -> impl ExactSizeIterator<Item = &[u32]> + Clone {
        let Topology {
            corners, offsets, ..
        } = &*self.topology;
        offsets
            .windows(2)
            .map(|ends| &corners[ends[0] as usize..ends[1] as usize])
    }

    /// The number of polygons.
    pub fn polygon_count(&self) -> usize {
        self.topology.offsets.len() - 1
    }

    /// The fan triangulation: polygon `(c0, c1, .., cn)` gives `(c0, c1, c2)`, `(c0, c2, c3)`, .. in polygon order.
    ///
    /// A fan is exact for convex planar polygons; a non-convex or twisted polygon is covered by these triangles all the same.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.topology.triangles
    }

    /// The three positions of a triangle.
    pub(crate) fn triangle_points(&self, triangle: [u32; 3]) -> [Vector3<f64>; 3] {
        triangle.map(|vertex| self.vertices[vertex as usize])
    }

    /// Smallest and largest corner of the axis-aligned box around all vertices, used or not.
    pub fn bounding_box(&self) -> (Vector3<f64>, Vector3<f64>) {
        let first = self.vertices[0];
        self.vertices
            .iter()
            .fold((first, first), |(low, high), vertex| {
                (low.inf(vertex), high.sup(vertex))
            })
    }

    /// Length of the bounding box's diagonal.
    pub fn diagonal(&self) -> f64 {
        let (low, high) = self.bounding_box();
        (high - low).norm()
    }

    /// Total area of the triangles.
    pub fn area(&self) -> f64 {
        self.triangles()
            .iter()
            .map(|&triangle| 0.5 * doubled_area(&self.triangle_points(triangle)).norm())
            .sum()
    }

    /// Enclosed volume by the divergence theorem, sum over triangles of `det(a - o, b - o, c - o) / 6`; positive when the
    /// polygons face outwards.
    ///
    /// `o` is the centre of the bounding box, which keeps cancellation small. An open surface has no volume of its own:
    /// its value depends on `o`.
    pub fn signed_volume(&self) -> f64 {
        let (low, high) = self.bounding_box();
        let origin = (low + high) / 2.0;
        self.triangles()
            .iter()
            .map(|&triangle| cone_volume(&self.triangle_points(triangle), &origin))
            .sum()
    }

    /// Area of each vertex: a third of the area of every triangle around it. The sum is [`Surface::area`].
    pub fn vertex_areas(&self) -> Vec<f64> {
        let mut areas = vec![0.0; self.vertices.len()];
        for &triangle in self.triangles() {
            let third = doubled_area(&self.triangle_points(triangle)).norm() / 6.0;
            for vertex in triangle {
                areas[vertex as usize] += third;
            }
        }
        areas
    }
}

/// The triangle's normal with the length of twice its area.
pub(crate) fn doubled_area([a, b, c]: &[Vector3<f64>; 3]) -> Vector3<f64> {
    (b - a).cross(&(c - a))
}

/// Signed volume of the tetrahedron from `origin` over a triangle.
pub(crate) fn cone_volume([a, b, c]: &[Vector3<f64>; 3], origin: &Vector3<f64>) -> f64 {
    (a - origin).dot(&(b - origin).cross(&(c - origin))) / 6.0
}

fn fan_triangulation(corners: &[u32], offsets: &[u32]) -> Vec<[u32; 3]> {
    let mut triangles = Vec::with_capacity(corners.len() - 2 * (offsets.len() - 1));
    for ends in offsets.windows(2) {
        let polygon = &corners[ends[0] as usize..ends[1] as usize];
        triangles.extend(
            polygon[1..]
                .windows(2)
                .map(|side| [polygon[0], side[0], side[1]]),
        );
    }
    triangles
}

fn index_count(count: usize) -> Result<u32, SurfaceError> {
    u32::try_from(count).map_err(|_| SurfaceError::TooLarge { count })
}

fn check_finite(vertices: &[Vector3<f64>]) -> Result<(), SurfaceError> {
    match vertices
        .iter()
        .position(|vertex| !vertex.iter().all(|x| x.is_finite()))
    {
        Some(vertex) => Err(SurfaceError::NonFiniteVertex {
            vertex,
            position: vertices[vertex],
        }),
        None => Ok(()),
    }
}
