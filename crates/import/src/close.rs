//! Holes closed by fans, so that a surface bounds a solid that can be voxelised.

use std::collections::{BTreeMap, HashSet};

use nalgebra::Vector3;
use surface_mesh::{Surface, report};

use crate::error::{ImportError, Result};

/// A surface without holes.
#[derive(Clone, Debug)]
pub struct Closed {
    /// The surface: the vertices and polygons it had, then one vertex and a fan of triangles for every hole.
    pub surface: Surface,
    /// The corners around each hole that was closed. Its centre is the vertex behind those of the open surface, in this order.
    pub holes: Vec<Vec<u32>>,
}

/// Closes every hole by triangles from its border to an added vertex at the mean of the border's corners.
///
/// Vertices and polygons keep their places, so that morph targets still fit with one zero delta for every hole. `name` is what
/// errors call the surface.
///
/// # Errors
/// [`ImportError::TouchingHoles`], or [`ImportError::NotSolid`] where the result bounds no solid: polygons turned over, edges with
/// more than two polygons, or a surface that faces inwards.
pub fn close_holes(surface: &Surface, name: &str) -> Result<Closed> {
    let holes = borders(surface, name)?;
    let mut vertices = surface.vertices().to_vec();
    let mut polygons: Vec<Vec<u32>> = surface.polygons().map(<[u32]>::to_vec).collect();
    for hole in &holes {
        let corners = hole.iter().map(|&corner| vertices[corner as usize]);
        let centre = corners.sum::<Vector3<f64>>() / hole.len() as f64;
        let apex = vertices.len() as u32;
        vertices.push(centre);
        let sides = (0..hole.len()).map(|i| (hole[i], hole[(i + 1) % hole.len()]));
        polygons.extend(sides.map(|(from, to)| vec![from, to, apex]));
    }
    let surface = Surface::from_polygons(vertices, polygons)?;
    require_solid(&surface, name)?;
    Ok(Closed { surface, holes })
}

/// Demands a surface that bounds a solid.
fn require_solid(surface: &Surface, name: &str) -> Result<()> {
    let report = report(surface);
    if report.is_solid() {
        return Ok(());
    }
    Err(ImportError::NotSolid {
        name: name.into(),
        report: Box::new(report),
    })
}

/// The corners around every hole, in the direction in which the missing polygons would run, each from its lowest corner.
fn borders(surface: &Surface, name: &str) -> Result<Vec<Vec<u32>>> {
    let mut sides = HashSet::new();
    for polygon in surface.polygons() {
        for (i, &from) in polygon.iter().enumerate() {
            sides.insert((from, polygon[(i + 1) % polygon.len()]));
        }
    }
    let mut next = BTreeMap::new();
    for &(from, to) in &sides {
        if !sides.contains(&(to, from)) && next.insert(to, from).is_some() {
            return Err(ImportError::TouchingHoles {
                name: name.into(),
                vertex: to,
            });
        }
    }
    let mut holes = Vec::new();
    while let Some((first, mut corner)) = next.pop_first() {
        let mut hole = vec![first];
        while corner != first {
            hole.push(corner);
            // A border that breaks off or runs into another has a vertex with two sides in or out.
            corner = next.remove(&corner).ok_or(ImportError::TouchingHoles {
                name: name.into(),
                vertex: corner,
            })?;
        }
        holes.push(hole);
    }
    Ok(holes)
}
