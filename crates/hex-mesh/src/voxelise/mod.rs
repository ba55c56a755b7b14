//! From a closed surface to a mesh of cubes.

mod bones;
mod candidates;
mod carriers;
mod closed;
mod corners;
mod cut;
mod grid;
mod inside;
mod links;
mod number;
mod options;
mod pieces;
mod report;
mod segments;
mod thin;

use nalgebra::Vector3;
use surface_mesh::Surface;

use bones::{BonePoints, check_bones};
use candidates::{Candidate, Candidates, NONE};
use carriers::Parts;
pub(crate) use closed::check_closed;
use corners::Corners;
use cut::CutCells;
use grid::CellGrid;
pub(crate) use inside::{InsideVotes, PointGrid};
use links::FaceLinks;
use number::NumberedParts;
pub use options::{Keep, Splitting, VoxelOptions};
use pieces::{NO_PIECE, Pieces, grid_position};
pub use report::{DroppedPiece, VoxelReport};
use thin::cover_thin;

use crate::{Embedding, HexMesh, HexMeshError, Quadrature, embed, embed_in};

/// A voxelised body, and what was found on the way.
#[derive(Debug, Clone, PartialEq)]
pub struct Voxelised {
    /// The mesh.
    pub mesh: HexMesh,
    /// What was found, and what was left out.
    pub report: VoxelReport,
    /// For each bone that was given, the nodes that it holds, by rising index: those inside it, among them those on the boundary between
    /// flesh and the cells that were left out for the bone. No node is listed twice.
    pub bone_nodes: Vec<Vec<u32>>,
    /// What lies where within the cells; nothing when cells were not to be split.
    parts: Option<Parts>,
}

impl Voxelised {
    /// Ties the vertices of the voxelised surface to the mesh, each to an element of its own part of the body.
    ///
    /// [`embed`](crate::embed) takes the nearest cube, be it across a gap: a vertex of the upper lip may be carried by the lower one.
    /// Here the element is reached from the vertex through material, on the inner side of the surface, and among the elements that
    /// are reached first the nearest cube is taken. Where no element is in reach (within four cells), or the body is too thin for the
    /// samples, the search starts from the elements of the nearest vertices along the surface. Where these have none either, or when
    /// cells were not to be split, [`embed`](crate::embed) decides.
    ///
    /// `surface` is the one that was voxelised, as it was then; its triangles face outwards all, or inwards all.
    ///
    /// # Errors
    /// [`HexMeshError::PointNotFinite`].
    pub fn embed_surface(&self, surface: &Surface) -> Result<Embedding, HexMeshError> {
        let nearest = embed(&self.mesh, surface.vertices())?;
        let Some(parts) = &self.parts else {
            return Ok(nearest);
        };
        let carriers = parts.carriers(&self.mesh, surface, nearest.vertices());
        let elements = carriers.iter().zip(nearest.vertices());
        let elements = elements.map(|(carrier, nearest)| carrier.unwrap_or(nearest.element));
        embed_in(
            &self.mesh,
            surface.vertices(),
            &elements.collect::<Vec<_>>(),
        )
    }
}

/// Fills a closed surface with cubes: a cell is in when its centre is inside, and a cell that holds several separate parts of the
/// body becomes one element for each.
///
/// A centre is inside when at least two of three axis-parallel rays through it cross the surface an odd number of times. Where
/// closed parts overlap, parity counts an even overlap as outside. Cells that meet only in an edge or a vertex belong to different
/// pieces.
///
/// The parts of a cell are found by [`Splitting`]; where a cell holds several that fill enough of it, all become elements, wherever
/// its centre lies. Elements of different cells share the nodes at a lattice point when material connects their parts within the eight
/// cells around it. What is too thin to hold cell centres has no element, unless [`Splitting::cover_thin`] asks for it. So elements at both sides of a gap, in one cell or in two, have nodes of their own at the same places. A body
/// without gaps gets the same mesh with and without splitting.
///
/// Elements run in lexicographic order of their cell, x slowest, then by their part's first sample; nodes run as elements first use
/// them. The result does not depend on the number of threads.
///
/// # Errors
/// [`HexMeshError::ElementSize`], [`HexMeshError::SplitSamples`], [`HexMeshError::SplitFraction`], [`HexMeshError::VertexNotFinite`],
/// [`HexMeshError::OpenSurface`], [`HexMeshError::Origin`], [`HexMeshError::TooManyCells`], [`HexMeshError::LargerThanBody`] when
/// one cell is larger than the bounding box, and [`HexMeshError::NoCells`] or [`HexMeshError::FlatSurface`] when no centre is inside.
pub fn voxelise(surface: &Surface, options: &VoxelOptions) -> Result<Voxelised, HexMeshError> {
    voxelise_with_bones(surface, &[], options)
}

/// Like [`voxelise`], without the cells whose corners all lie inside one of the closed surfaces `bones` (but see
/// [`VoxelOptions::cover_bones`]).
///
/// [`Voxelised::bone_nodes`] lists the nodes that move with each bone: those inside it, so that no flesh outside of a bone is held. A
/// node inside of several goes to the first. Bones may stick out of the body. Flesh that
/// bones cut off is a piece of its own, see [`VoxelOptions::keep`].
///
/// # Errors
/// Those of [`voxelise`], [`HexMeshError::Bone`] when a bone is open or not finite, and [`HexMeshError::NoFlesh`] when nothing is left.
pub fn voxelise_with_bones(
    surface: &Surface,
    bones: &[Surface],
    options: &VoxelOptions,
) -> Result<Voxelised, HexMeshError> {
    options.check()?;
    check_closed(surface.vertices(), surface.triangles())?;
    check_bones(bones)?;
    let size = options.element_size;
    let (min, max) = bounding_box(surface);
    let grid = place_grid(surface, options, min, max)?;
    let votes = InsideVotes::new(&grid.centres(), surface.vertices(), surface.triangles());
    let (candidates, corners, cut) = find_candidates(surface, options, &grid, &votes);
    if candidates.list.is_empty() {
        let advice = suggested_size(surface, size, min, max)?;
        return Err(HexMeshError::NoCells {
            element_size: size,
            min,
            max,
            suggested_size: advice,
        });
    }
    let bone_points = BonePoints::new(bones, &grid);
    let bone_of = bone_points.of_candidates(&candidates, &corners, &grid, options.cover_bones);
    let is_flesh = |candidate: usize| bone_of[candidate] == NONE;
    let pieces = Pieces::new(grid.counts, &candidates, &corners, is_flesh);
    let Some(largest) = pieces.largest() else {
        let cells = candidates.list.len();
        return Err(HexMeshError::NoFlesh { cells });
    };
    let kept = |piece: usize| options.keep == Keep::All || piece == largest;

    // Lexicographic: the pass of `benches/ordering.rs` over balls of 58 thousand and 1.0 million elements takes 3.6 and 79 ms in this
    // order, 5.4 and 102 ms in Morton order, 5.7 and 149 ms in blocks of 8^3, 5.3 and 173 ms in blocks of 4^3.
    let mut elements = Vec::new();
    let mut element_of = vec![NONE; candidates.list.len()];
    for (candidate, &piece) in pieces.of_candidate.iter().enumerate() {
        if piece != NO_PIECE && kept(piece as usize) {
            element_of[candidate] = elements.len() as u32;
            elements.push(candidates.list[candidate]);
        }
    }
    let numbered = NumberedParts::new(&elements, &corners);
    let mesh = build_mesh(&elements, &numbered, &corners, &grid, options.quadrature);
    let in_one_cell = elements.chunk_by(|a, b| a.cell == b.cell);
    let report = VoxelReport {
        element_size: size,
        grid: grid.counts,
        elements: mesh.elements().len(),
        nodes: mesh.nodes().len(),
        mesh_volume: mesh.volume(),
        surface_volume: surface.signed_volume(),
        pieces: pieces.pieces.len(),
        dropped: dropped_pieces(&grid, &pieces, kept),
        minority_votes: votes.minority_count(),
        split_cells: in_one_cell.filter(|same| same.len() > 1).count(),
        shared_points: bone_points.shared,
        bone_elements: bone_of.iter().filter(|&&bone| bone != NONE).count(),
    };
    Ok(Voxelised {
        mesh,
        report,
        bone_nodes: bone_points.nodes(&numbered),
        parts: cut.map(|cut| Parts {
            grid,
            cut,
            elements: candidates.for_parts(&element_of),
        }),
    })
}

fn place_grid(
    surface: &Surface,
    options: &VoxelOptions,
    min: Vector3<f64>,
    max: Vector3<f64>,
) -> Result<CellGrid, HexMeshError> {
    let size = options.element_size;
    // A centred cell of any size has its centre inside a convex body.
    if size > (max - min).max() {
        let advice = suggested_size(surface, size, min, max)?;
        return Err(HexMeshError::LargerThanBody {
            element_size: size,
            min,
            max,
            suggested_size: advice,
        });
    }
    match options.origin {
        None => CellGrid::centred(min, max, size),
        Some(origin) => CellGrid::anchored(min, max, size, origin),
    }
}

/// The elements to be, which of them share nodes, and the parts of the cells if these are to be split.
fn find_candidates(
    surface: &Surface,
    options: &VoxelOptions,
    grid: &CellGrid,
    votes: &InsideVotes,
) -> (Candidates, Corners, Option<CutCells>) {
    let cells = grid.counts.iter().product();
    let Some(split) = options.split else {
        let candidates = Candidates::new(cells, votes, None, 1.0);
        return (candidates, Corners::whole(grid.counts), None);
    };
    let (vertices, triangles) = (surface.vertices(), surface.triangles());
    let cut = CutCells::new(grid, split.samples, votes, vertices, triangles);
    let mut candidates = Candidates::new(cells, votes, Some(&cut), split.least_fraction);
    let links = FaceLinks::new(&cut);
    if split.cover_thin {
        cover_thin(&mut candidates, &cut, &links);
    }
    let corners = Corners::new(&cut, &links, &candidates);
    candidates.unite_inseparable(&corners);
    (candidates, corners, Some(cut))
}

fn build_mesh(
    elements: &[Candidate],
    numbered: &NumberedParts,
    corners: &Corners,
    grid: &CellGrid,
    quadrature: Quadrature,
) -> HexMesh {
    let position = |element: &Candidate| grid_position(element.cell as usize, grid.counts);
    let cells = elements.iter().map(|element| grid.cell(position(element)));
    let points = numbered.points.iter();
    let points = points.map(|&point| grid.cell(corners.position(point as usize)));
    HexMesh::from_numbered(
        cells.collect(),
        &points.collect::<Vec<_>>(),
        numbered.elements.clone(),
        grid.origin,
        grid.size,
        quadrature,
    )
}

fn dropped_pieces(
    grid: &CellGrid,
    pieces: &Pieces,
    kept: impl Fn(usize) -> bool,
) -> Vec<DroppedPiece> {
    let dropped = pieces.pieces.iter().enumerate();
    let mut dropped: Vec<_> = dropped
        .filter(|&(index, _)| !kept(index))
        .map(|(_, piece)| DroppedPiece {
            elements: piece.elements,
            min: grid.corner(grid.cell(piece.min)),
            max: grid.corner(grid.cell(piece.max).map(|i| i + 1)),
        })
        .collect();
    dropped.sort_by_key(|piece| std::cmp::Reverse(piece.elements));
    dropped
}

/// Box around the vertices that triangles use: stray vertices must not enlarge the grid.
fn bounding_box(surface: &Surface) -> (Vector3<f64>, Vector3<f64>) {
    let used = surface.triangles().iter().flatten();
    let used = used.map(|&vertex| surface.vertices()[vertex as usize]);
    let nothing = Vector3::repeat(f64::INFINITY);
    used.fold((nothing, -nothing), |(min, max), vertex| {
        (min.inf(&vertex), max.sup(&vertex))
    })
}

#[cold]
fn suggested_size(
    surface: &Surface,
    element_size: f64,
    min: Vector3<f64>,
    max: Vector3<f64>,
) -> Result<f64, HexMeshError> {
    // Volume over area is half the thickness of a plate and a third of the radius of a ball.
    let thickness = surface.signed_volume().abs() / surface.area();
    // Without any area the thickness is NaN.
    if thickness.is_nan() || thickness <= 1e-12 * (max - min).norm() {
        return Err(HexMeshError::FlatSurface { min, max });
    }
    Ok(thickness.min(0.5 * element_size))
}
