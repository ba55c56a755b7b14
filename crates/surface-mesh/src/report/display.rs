//! The report as a short text.

use std::fmt::{self, Display, Formatter};

use super::{Component, Edge, SurfaceReport};
use crate::error::point;

impl Display for SurfaceReport {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        self.headline(f)?;
        self.edge_findings(f)?;
        self.part_findings(f)
    }
}

impl SurfaceReport {
    fn headline(&self, f: &mut Formatter) -> fmt::Result {
        let verdict = if self.is_solid() {
            "solid (closed, consistently turned, facing outwards)"
        } else if self.is_closed() {
            "closed, but not a clean solid"
        } else {
            "NOT closed"
        };
        write!(
            f,
            "{} vertices, {} polygons ({} triangles), {}: {verdict}; volume {}",
            self.vertices,
            self.polygons,
            self.triangles,
            counted(self.components.len(), "piece"),
            rounded(self.signed_volume),
        )?;
        if self.components.len() > 1 {
            self.pieces(f)?;
        }
        Ok(())
    }

    fn pieces(&self, f: &mut Formatter) -> fmt::Result {
        const SHOWN: usize = 5;
        let mut largest: Vec<&Component> = self.components.iter().collect();
        largest.sort_by_key(|piece| std::cmp::Reverse(piece.vertices));
        let mut list: Vec<String> = largest
            .iter()
            .take(SHOWN)
            .map(|piece| piece.vertices.to_string())
            .collect();
        if largest.len() > SHOWN {
            list.push("..".into());
        }
        write!(f, "\n  pieces of {} vertices", list.join(", "))
    }

    fn edge_findings(&self, f: &mut Formatter) -> fmt::Result {
        if let Some(edge) = self.open_edges.first() {
            write!(
                f,
                "\n  {} in {}, e.g. {}: fill the hole there, or weld vertices that lie together",
                counted(self.open_edges.len(), "open edge"),
                counted(self.open_loops, "loop"),
                Shown(edge),
            )?;
        }
        if let Some(edge) = self.non_manifold_edges.first() {
            write!(
                f,
                "\n  {} with more than two polygons, e.g. {} with {}: delete inner or doubled polygons there, \
                 or separate the sheets",
                counted(self.non_manifold_edges.len(), "edge"),
                Shown(edge),
                edge.uses,
            )?;
        }
        if let Some(edge) = self.inconsistent_edges.first() {
            write!(
                f,
                "\n  {} between polygons turned opposite ways, e.g. {}: recompute the orientation \
                 (\"normals outside\")",
                counted(self.inconsistent_edges.len(), "edge"),
                Shown(edge),
            )?;
        }
        if self.is_inside_out() {
            f.write_str("\n  inside out (negative volume): flip all polygons")?;
        }
        Ok(())
    }

    fn part_findings(&self, f: &mut Formatter) -> fmt::Result {
        if let Some(first) = self.degenerate_polygons.first() {
            write!(
                f,
                "\n  {} without area or with a repeated corner, e.g. polygon {first}: delete or collapse",
                counted(self.degenerate_polygons.len(), "polygon"),
            )?;
        }
        if let Some(first) = self.unused_vertices.first() {
            write!(
                f,
                "\n  {} in no polygon, e.g. vertex {first}: harmless, delete to save space",
                counted_vertices(self.unused_vertices.len()),
            )?;
        }
        if let Some(first) = self.duplicate_vertices.first() {
            write!(
                f,
                "\n  {} at the place of another, e.g. vertex {first}: weld where an edge is open between them",
                counted_vertices(self.duplicate_vertices.len()),
            )?;
        }
        Ok(())
    }
}

/// An edge as vertices and positions.
struct Shown<'a>(&'a Edge);

impl Display for Shown<'_> {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        let Edge {
            vertices: [a, b],
            positions: [from, to],
            ..
        } = self.0;
        write!(f, "vertices {a}-{b} at {} - {}", point(from), point(to))
    }
}

fn counted(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

fn counted_vertices(count: usize) -> String {
    format!("{count} {}", if count == 1 { "vertex" } else { "vertices" })
}

/// Four significant digits.
fn rounded(value: f64) -> String {
    let magnitude = value.abs();
    if magnitude == 0.0 || (1e-3..1e7).contains(&magnitude) {
        let decimals = if magnitude == 0.0 {
            0
        } else {
            (3 - magnitude.log10().floor() as i32).max(0) as usize
        };
        format!("{value:.decimals$}")
    } else {
        format!("{value:.3e}")
    }
}
