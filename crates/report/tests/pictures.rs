//! Pictures, sheets, plots and files against what must be seen in them.

use nalgebra::Vector3;
use report::{
    BACKGROUND, CLAY, Camera, ColourScale, Colours, ComparisonSheet, ContactSheet, Image, LinePlot,
    Mesh, Panel, ReportError, Row, Series, render,
};
use surface_mesh::primitives::icosphere;

fn camera(points: &[Vector3<f64>]) -> Camera {
    Camera::framing(points, -Vector3::z(), Vector3::y()).unwrap()
}

fn plain<'a>(vertices: &'a [Vector3<f64>], triangles: &'a [[u32; 3]]) -> Mesh<'a> {
    Mesh {
        vertices,
        triangles,
        colours: Colours::Uniform(CLAY),
    }
}

fn covered(image: &Image) -> usize {
    image
        .pixels()
        .iter()
        .filter(|&&pixel| pixel != BACKGROUND)
        .count()
}

fn brightness(colour: [u8; 3]) -> u32 {
    colour.iter().map(|&channel| u32::from(channel)).sum()
}

#[test]
fn a_ball_fills_the_disc_it_must() {
    let ball = icosphere(4, 1.0);
    let mesh = plain(ball.vertices(), ball.triangles());
    let image = render(&mesh, &camera(ball.vertices()), 300, 300).unwrap();
    let radius = 150.0 / 1.05;
    let exact = std::f64::consts::PI * radius * radius;
    // Pixels cut by the outline count whole: at most half the circumference too many.
    let excess = covered(&image) as f64 - exact;
    assert!(
        (-0.005 * exact..0.75 * std::f64::consts::TAU * radius).contains(&excess),
        "{excess}"
    );
    // No holes, lit from the upper left.
    for (x, y) in (75..225).flat_map(|x| (75..225).map(move |y| (x, y))) {
        assert_ne!(image.pixel(x, y), BACKGROUND, "hole at {x}, {y}");
    }
    assert!(brightness(image.pixel(95, 95)) > brightness(image.pixel(205, 205)));
}

#[test]
fn nearer_surfaces_hide_farther_ones_in_any_order_and_view() {
    let square = |z: f64, size: f64| {
        [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
            .map(|(x, y)| Vector3::new(x * size, y * size, z))
    };
    let vertices: Vec<_> = square(0.0, 1.0)
        .into_iter()
        .chain(square(0.5, 0.5))
        .collect();
    let (red, blue) = ([220, 30, 30], [30, 30, 220]);
    let colours = [[red; 4], [blue; 4]].concat();
    let far = [[0, 1, 2], [0, 2, 3]];
    let near = [[4, 5, 6], [4, 6, 7]];
    let perspective =
        Camera::framing_perspective(&vertices, -Vector3::z(), Vector3::y(), 0.6).unwrap();
    for camera in [camera(&vertices), perspective] {
        for triangles in [[far, near].concat(), [near, far].concat()] {
            let mesh = Mesh {
                vertices: &vertices,
                triangles: &triangles,
                colours: Colours::PerVertex(&colours),
            };
            let image = render(&mesh, &camera, 100, 100).unwrap();
            let [red, _, blue] = image.pixel(50, 50);
            assert!(blue > red, "the near square must hide the far one");
            let [red, _, blue] = image.pixel(10, 10);
            assert!(red > blue, "the far square must be seen around it");
        }
    }
}

#[test]
fn edges_are_smoothed() {
    let vertices = [
        Vector3::new(0.0, 0.0, 0.0),
        Vector3::new(1.0, 0.1, 0.0),
        Vector3::new(0.0, 1.0, 0.0),
    ];
    let image = render(
        &plain(&vertices, &[[0, 1, 2]]),
        &camera(&vertices),
        120,
        120,
    )
    .unwrap();
    let inside = brightness(image.pixel(30, 70));
    let between = image
        .pixels()
        .iter()
        .filter(|&&pixel| (inside + 20..brightness(BACKGROUND) - 20).contains(&brightness(pixel)));
    assert!(between.count() > 40);
}

#[test]
fn both_sides_are_lit_alike() {
    let vertices = [Vector3::zeros(), Vector3::x(), Vector3::y()];
    let picture =
        |triangle| render(&plain(&vertices, &[triangle]), &camera(&vertices), 60, 60).unwrap();
    assert_eq!(picture([0, 1, 2]), picture([0, 2, 1]));
}

#[test]
fn shared_edges_leave_no_cracks() {
    // A fan of slivers about an awkward centre: every inner pixel must be covered.
    let mut vertices = vec![Vector3::new(0.123_456, -0.076_543, 0.0)];
    let count = 97;
    vertices.extend((0..count).map(|spoke| {
        let angle = f64::from(spoke) / f64::from(count) * std::f64::consts::TAU;
        Vector3::new(angle.cos(), angle.sin(), 0.0)
    }));
    let triangles: Vec<_> = (0..count as u32)
        .map(|spoke| [0, 1 + spoke, 1 + (spoke + 1) % count as u32])
        .collect();
    let colours = vec![[0, 0, 0]; vertices.len()];
    let mesh = Mesh {
        vertices: &vertices,
        triangles: &triangles,
        colours: Colours::PerVertex(&colours),
    };
    let image = render(&mesh, &camera(&vertices), 211, 211).unwrap();
    for (x, y) in (40..171).flat_map(|x| (40..171).map(move |y| (x, y))) {
        assert!(brightness(image.pixel(x, y)) < 6, "crack at {x}, {y}");
    }
}

#[test]
fn pictures_do_not_depend_on_the_number_of_threads() {
    let ball = icosphere(4, 1.0);
    let mesh = plain(ball.vertices(), ball.triangles());
    let camera = camera(ball.vertices());
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| render(&mesh, &camera, 200, 150).unwrap())
    };
    assert_eq!(on(1), on(3));
}

#[test]
fn vertices_behind_the_eye_or_far_outside_do_no_harm() {
    let ball = icosphere(2, 1.0);
    let close = Camera::framing_perspective(
        &[Vector3::zeros(), Vector3::x() * 1e-6],
        -Vector3::z(),
        Vector3::y(),
        0.4,
    )
    .unwrap();
    let mesh = plain(ball.vertices(), ball.triangles());
    render(&mesh, &close, 64, 64).unwrap();
    let tiny = Camera::framing(
        &[Vector3::zeros(), Vector3::x() * 1e-9],
        -Vector3::z(),
        Vector3::y(),
    )
    .unwrap();
    assert_eq!(covered(&render(&mesh, &tiny, 64, 64).unwrap()), 64 * 64);
}

#[test]
fn bad_meshes_and_cameras_are_named() {
    let vertices = [Vector3::zeros(), Vector3::x(), Vector3::y()];
    let view = camera(&vertices);
    let draw = |mesh: &Mesh| render(mesh, &view, 9, 9).unwrap_err();
    assert!(matches!(
        draw(&plain(&vertices, &[[0, 1, 3]])),
        ReportError::VertexIndex {
            triangle: 0,
            vertex: 3,
            vertices: 3
        }
    ));
    let broken = [
        Vector3::zeros(),
        Vector3::new(0.0, f64::NAN, 0.0),
        Vector3::y(),
    ];
    assert!(matches!(
        draw(&plain(&broken, &[[0, 1, 2]])),
        ReportError::NonFiniteVertex { vertex: 1, .. }
    ));
    let short = Mesh {
        colours: Colours::PerVertex(&[CLAY]),
        ..plain(&vertices, &[[0, 1, 2]])
    };
    assert!(matches!(
        draw(&short),
        ReportError::ColourCount {
            colours: 1,
            vertices: 3
        }
    ));
    assert!(render(&plain(&vertices, &[]), &view, 0, 9).is_err());
    assert!(matches!(
        Camera::framing(&[], Vector3::z(), Vector3::y()),
        Err(ReportError::NothingToFrame)
    ));
    for direction in [Vector3::y(), Vector3::zeros(), Vector3::repeat(f64::NAN)] {
        let view = Camera::framing(&vertices, direction, Vector3::y());
        assert!(matches!(view, Err(ReportError::CameraAxes { .. })));
    }
}

fn row<'a>(name: &'a str, vertices: &'a [Vector3<f64>], errors: &'a [f64]) -> Row<'a> {
    Row {
        name,
        triangles: &[[0, 1, 2]],
        target_triangles: None,
        target: vertices,
        simulated: vertices,
        errors,
        note: "a note so long that it cannot be written on one line and must be broken and in the end shortened ".repeat(3).leak(),
    }
}

#[test]
fn sheets_break_into_equally_wide_pages_with_free_borders() {
    let vertices = [Vector3::zeros(), Vector3::x(), Vector3::y() * 0.3];
    let mut sheet = ComparisonSheet::new(
        "A title that is much too long for the sheet ".repeat(9),
        "mm",
    )
    .rows_per_page(4)
    .panel_width(120);
    for _ in 0..9 {
        sheet = sheet.row(row(
            "a_name_without_any_space_to_break_it_at_all",
            &vertices,
            &[0.0, 0.7, 0.2],
        ));
    }
    let pages = sheet.scale_end(0.5).render().unwrap();
    assert_eq!(pages.len(), 3);
    assert!(pages.iter().all(|page| page.width() == pages[0].width()));
    for page in &pages {
        for x in 0..page.width() {
            assert!((0..8).all(|y| page.pixel(x, y) == BACKGROUND
                && page.pixel(x, page.height() - 1 - y) == BACKGROUND));
        }
        for y in 0..page.height() {
            assert!((0..8).all(|x| page.pixel(x, y) == BACKGROUND
                && page.pixel(page.width() - 1 - x, y) == BACKGROUND));
        }
    }
}

#[test]
fn bad_rows_are_named() {
    let vertices = [Vector3::zeros(), Vector3::x(), Vector3::y()];
    let render = |row| {
        ComparisonSheet::new("t", "mm")
            .row(row)
            .render()
            .unwrap_err()
    };
    assert!(matches!(
        ComparisonSheet::new("t", "mm").render(),
        Err(ReportError::EmptySheet)
    ));
    assert!(matches!(
        render(row("smile", &vertices, &[0.0])),
        ReportError::RowCount {
            row: 0,
            errors: 1,
            ..
        }
    ));
    assert!(matches!(
        render(row("smile", &vertices, &[0.0, -1.0, 0.0])),
        ReportError::RowError {
            row: 0,
            vertex: 1,
            ..
        }
    ));
    let fewer = Row {
        target: &vertices[..2],
        ..row("smile", &vertices, &[0.0; 3])
    };
    assert!(matches!(
        render(fewer),
        ReportError::RowCount { target: 2, .. }
    ));
    let missing = Row {
        triangles: &[[0, 1, 7]],
        ..row("smile", &vertices, &[0.0; 3])
    };
    assert!(
        render(missing)
            .to_string()
            .starts_with("row 0 (smile): triangle 0 names vertex 7")
    );
}

#[test]
fn a_target_may_be_another_mesh() {
    let vertices = [Vector3::zeros(), Vector3::x(), Vector3::y()];
    let square = [vertices.as_slice(), &[Vector3::new(1.0, 1.0, 0.0)]].concat();
    let other = Row {
        target: &square,
        target_triangles: Some(&[[0, 1, 2], [1, 3, 2]]),
        ..row("scan", &vertices, &[0.0; 3])
    };
    let same = Row {
        target: &square[..3],
        target_triangles: None,
        simulated: &square[..3],
        ..other
    };
    let page = |row| ComparisonSheet::new("t", "mm").row(row).render().unwrap();
    let clay = |image: &report::Image| {
        let places = (0..image.width()).flat_map(|x| (0..image.height()).map(move |y| (x, y)));
        places
            .filter(|&(x, y)| image.pixel(x, y) != BACKGROUND)
            .count()
    };
    assert!(clay(&page(other)[0]) > clay(&page(same)[0]) + 1000);
    let missing = Row {
        target_triangles: Some(&[[0, 1, 4]]),
        ..other
    };
    let refused = ComparisonSheet::new("t", "mm").row(missing).render();
    assert!(matches!(refused, Err(ReportError::Row { row: 0, .. })));
}

fn plot(points: Vec<(f64, f64)>) -> LinePlot {
    LinePlot {
        title: "Cost <$5 & \"more\"".into(),
        x_label: "time (s)".into(),
        y_label: "error (mm)".into(),
        series: vec![Series::new("first", points)],
        log_x: true,
        log_y: true,
        markers: true,
        labels: Vec::new(),
    }
}

#[test]
fn plots_are_drawn_with_their_text_and_refuse_what_they_cannot_show() {
    let good = plot(vec![(0.1, 1.0), (1.0, 0.1), (10.0, 0.01)]);
    let svg = good.svg().unwrap();
    assert!(svg.starts_with("<svg") && svg.contains("time (s)") && svg.contains("first"));
    assert!(
        svg.contains("Cost &lt;$5 &amp;"),
        "the title must be escaped and literal"
    );
    assert!(good.png().unwrap().starts_with(b"\x89PNG"));
    assert!(matches!(
        plot(vec![]).svg(),
        Err(ReportError::EmptyPlot { .. })
    ));
    assert!(matches!(
        plot(vec![(1.0, 1.0), (2.0, 0.0)]).svg(),
        Err(ReportError::PlotPoint { point: 1, .. })
    ));
    assert!(plot(vec![(2.0, 3.0)]).svg().is_ok(), "one point is a plot");
    assert!(
        plot(vec![(1.0, 3.0), (2.0, 3.0)]).png().is_ok(),
        "a level line is a plot"
    );
}

#[test]
fn files_are_whole_readable_and_leave_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("picture.png");
    let mut image = Image::new(7, 5, [10, 20, 30]);
    image.fill(5, 3, 9, 9, [200, 100, 50]);
    image.write_png(&path).unwrap();
    image.write_png(&path).unwrap();
    let mut reader =
        png::Decoder::new(std::io::BufReader::new(std::fs::File::open(&path).unwrap()))
            .read_info()
            .unwrap();
    let mut bytes = vec![0; 7 * 5 * 3];
    reader.next_frame(&mut bytes).unwrap();
    assert_eq!(bytes, image.pixels().as_flattened());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let plain = folder.path().join("plain");
        std::fs::write(&plain, "").unwrap();
        let mode = |path| std::fs::metadata(path).unwrap().permissions().mode();
        assert_eq!(mode(&path), mode(&plain));
    }
    let nowhere = folder.path().join("missing").join("picture.png");
    assert!(matches!(
        image.write_png(nowhere),
        Err(ReportError::Write { .. })
    ));
}

#[test]
fn scales_colour_their_ends() {
    let scale = ColourScale::new(2.0, "mm").unwrap();
    assert_eq!(
        scale.colours(&[0.0, 2.0, 3.0]),
        [
            report::error_colour(0.0),
            report::error_colour(1.0),
            report::error_colour(1.0)
        ]
    );
}

#[test]
fn a_contact_sheet_shows_every_panel_in_its_place() {
    let ball = icosphere(3, 1.0);
    let panel = |name| Panel {
        name,
        note: "note",
        vertices: ball.vertices(),
        triangles: ball.triangles(),
        colours: Colours::Uniform(CLAY),
    };
    let sheet = |count: usize| {
        let names = ["one", "two", "three", "four", "five"];
        let mut sheet = ContactSheet::new("Balls", camera(ball.vertices()))
            .columns(2)
            .panel_width(120);
        for name in &names[..count] {
            sheet = sheet.panel(panel(name));
        }
        sheet.render()
    };
    let page = sheet(5).unwrap();
    // A row of two; three rows.
    let (width, height) = (page.width(), page.height());
    assert_eq!(width, 16 + 2 * 136);
    let row = (height - 56) / 3;
    for place in 0..6 {
        let (x, y) = (16 + 60 + place % 2 * 136, 56 + 60 + place / 2 * row);
        let drawn = page.pixel(x, y) != BACKGROUND;
        assert_eq!(drawn, place < 5, "{place}");
    }
    // The names differ, the pictures do not.
    let cut = |left: usize, top: usize, height: usize| -> Vec<[u8; 3]> {
        let rows = top..top + height;
        rows.flat_map(|y| (left..left + 120).map(move |x| (x, y)))
            .map(|(x, y)| page.pixel(x, y))
            .collect()
    };
    assert_eq!(cut(16, 56, 120), cut(152, 56, 120));
    assert_ne!(cut(16, 176, 18), cut(152, 176, 18));
    assert_eq!(sheet(1).unwrap().width(), 16 + 136);
    assert!(matches!(sheet(0), Err(ReportError::EmptySheet)));
    let broken = Panel {
        triangles: &[[0, 1, 9999]],
        ..panel("broken")
    };
    let refused = ContactSheet::new("", camera(ball.vertices()))
        .panel(panel("whole"))
        .panel(broken)
        .render();
    assert!(matches!(refused, Err(ReportError::Row { row: 1, .. })));
    // Coloured panels bring their scale along, beside the pictures.
    let scale = ColourScale::new(2.0, "mm").unwrap();
    let colours = vec![scale.colour(2.0); ball.vertex_count()];
    let coloured = ContactSheet::new("Balls", camera(ball.vertices()))
        .panel_width(120)
        .panel(Panel {
            colours: Colours::PerVertex(&colours),
            ..panel("far off")
        })
        .scale(scale)
        .render()
        .unwrap();
    let plain = sheet(1).unwrap();
    assert!(coloured.width() > plain.width());
    assert_eq!(coloured.height(), plain.height());
    assert_ne!(
        coloured.pixel(16 + 60, 56 + 60),
        plain.pixel(16 + 60, 56 + 60)
    );
    let beside = (0..coloured.height()).map(|y| coloured.pixel(16 + 136 + 4, y));
    assert!(beside.collect::<std::collections::HashSet<_>>().len() > 20);
}
