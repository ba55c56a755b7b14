//! Options and arrays of `solve` that do not fit: one clear line of error, and nothing written.

use myofield_tests::{Place, check};
use npyz::{Order, WriterBuilder};
use trainer::npy;

#[test]
fn an_actuation_that_does_not_fit() {
    let place = Place::new();
    let path = place.path("A.npy");
    let refuses = |parts: &[&str]| {
        let parts: Vec<&str> = parts
            .iter()
            .copied()
            .chain(["A.npy", "[2, 8, 6]"])
            .collect();
        place.refuses_box(&format!("--fix x=0 --actuation {}", path.display()), &parts);
    };
    let zeros = vec![0.0_f64; 2 * 8 * 6];
    for shape in [&[2, 6, 8][..], &[1, 16, 6], &[16, 6], &[96], &[2, 8, 6, 1]] {
        npy::write(&path, shape, &zeros).unwrap();
        refuses(&["its shape is", &format!("{shape:?}")]);
    }
    npy::write(&path, &[0, 8, 6], &[0.0_f64; 0]).unwrap();
    refuses(&["[0, 8, 6]"]);
    npy::write(&path, &[2, 8, 6], &[0.0_f32; 96]).unwrap();
    refuses(&["f4", "float64"]);
    npy::write(&path, &[2, 8, 6], &[0_i64; 96]).unwrap();
    refuses(&["i8", "float64"]);
    for (entry, value) in [(0, f64::NAN), (95, f64::INFINITY)] {
        let mut bad = zeros.clone();
        bad[entry] = value;
        npy::write(&path, &[2, 8, 6], &bad).unwrap();
        let at = if entry == 0 { "[0, 0, 0]" } else { "[1, 7, 5]" };
        refuses(&[at, &value.to_string()]);
    }
    let mut fortran = Vec::new();
    let options = npyz::WriteOptions::new()
        .default_dtype()
        .order(Order::Fortran);
    let mut writer = options
        .shape(&[2, 8, 6])
        .writer(&mut fortran)
        .begin_nd()
        .unwrap();
    writer.extend(zeros.iter().copied()).unwrap();
    writer.finish().unwrap();
    place.write("A.npy", &fortran);
    refuses(&["Fortran order", "C order"]);
    npy::write(&path, &[2, 8, 6], &zeros).unwrap();
    let whole = place.read("A.npy");
    for length in [0, 3, 6, 10, 40, 128, whole.len() / 2, whole.len() - 1] {
        place.write("A.npy", &whole[..length]);
        refuses(&[]);
    }
    place.write("A.npy", "0 0 0 0 0 0\n");
    refuses(&["not an npy file"]);
    std::fs::remove_file(&path).unwrap();
    let option = format!("--fix x=0 --actuation {}", path.display());
    place.refuses_box(&option, &["A.npy", "cannot read"]);
}

#[test]
fn a_cotangent_that_does_not_fit() {
    let place = Place::new();
    let path = place.path("C.npy");
    let option = format!("--fix x=0 --cotangent {}", path.display());
    npy::write(&path, &[8, 3], &[0.0; 24]).unwrap();
    place.refuses_box(&option, &["C.npy", "[8, 3]", "[12, 3]"]);
    npy::write(&path, &[12, 3], &[f64::NAN; 36]).unwrap();
    place.refuses_box(&option, &["C.npy", "[0, 0] is NaN"]);
}

#[test]
fn nodes_that_cannot_be_held() {
    let place = Place::new();
    place.refuses_box("", &["--fix", "x=min"]);
    for nothing in ["x=5", "x=0.5", "z>2", "y<-1"] {
        place.refuses_box(&format!("--fix {nothing}"), &["--fix", nothing, "no node"]);
    }
    for text in [
        "q=1", "x~1", "x=", "x", "=", "x=nan", "x>inf", "x>=0", "x=\u{e9}", "\u{e9}=1",
    ] {
        place.refuses_box(&format!("--fix {text}"), &["--fix", text, "x=0, y=max"]);
    }
    // A single node holds a body only against moving, which is enough.
    let out = place.path("out");
    check(format!(
        "solve --cells 2,1,1 --size 1 --fix x=0 --out {}",
        out.display()
    ))
    .succeeds();
}

#[test]
fn numbers_out_of_range() {
    let place = Place::new();
    for value in ["0", "-1", "nan", "inf", "-1e-3"] {
        for option in ["--accuracy", "--rel-grad"] {
            let options = format!("--fix x=0 {option} {value}");
            place.refuses_box(&options, &[option, "above zero"]);
        }
    }
    for value in ["0", "-1", "nan", "inf"] {
        place.refuses_box(&format!("--fix x=0 --stiffness {value}"), &["stiffness"]);
        let options = format!("--cells 2,1,1 --size {value} --fix x=0");
        place.refuses_solve(&options, &["size"]);
    }
    for samples in ["5", "0", "64"] {
        let options = format!("--fix x=0 --samples {samples}");
        place.refuses_box(&options, &["--samples", "1, 8 or 27"]);
    }
    place.refuses_box("--fix x=0 --accuracy 1e-3 --rel-grad 1e-3", &["--rel-grad"]);
    place.refuses_box("--fix x=0 --method euler", &["euler"]);
    place.refuses_box("--fix x=0 --max-iterations -3", &["-3"]);
}

#[test]
fn boxes_without_cells() {
    let place = Place::new();
    for cells in [
        "0,1,1", "1,2", "1,2,3,4", "a,b,c", "1,-2,1", "1.5,1,1", "1,,1",
    ] {
        let options = format!("--cells {cells} --size 1 --fix x=0");
        place.refuses_solve(&options, &["cells"]);
    }
    for cells in ["100000,100000,100000", "4294967295,4294967295,4294967295"] {
        let options = format!("--cells {cells} --size 1 --fix x=0");
        place.refuses_solve(&options, &["cells", "more than"]);
    }
    place.refuses_solve("--cells 2,1,1 --fix x=0", &["required"]);
    place.refuses_solve("--size 1 --fix x=0", &["required"]);
    place.refuses_solve("--fix x=0", &["required"]);
}
