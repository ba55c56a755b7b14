//! Every reader on the inputs that once did harm, on whole files, and on some thousands of damaged ones. One test for all, as memory is
//! counted for the process.

use myofield_fuzz::targets::kept;
use myofield_fuzz::watch::{Harm, execute};
use myofield_fuzz::{Outcome, Source, Target, corpus, targets};

/// Damaged inputs per reader.
const EXECUTIONS: u64 = 3000;

fn check(target: &Target, input: &[u8], name: &str) {
    if let Err(harm) = execute(target, input).result {
        panic!("{} on {name}: {harm}", target.name);
    }
}

/// Memory that a reader holds and does not need, so that the watch over readers is seen to work.
fn watched(read: fn(&[u8]) -> Outcome) -> Target {
    let mut target = targets().swap_remove(0);
    target.read = Box::new(read);
    target.allowance = |_| 1 << 16;
    target
}

fn outcome() -> Outcome {
    Outcome {
        accepted: true,
        message: String::new(),
    }
}

fn the_watch_sees_harm() {
    // A little less may be counted: what others gave back meanwhile.
    let greedy = watched(|_| {
        std::hint::black_box(vec![1_u8; 1 << 20]);
        outcome()
    });
    let result = execute(&greedy, b"").result;
    assert!(
        matches!(
            result,
            Err(Harm::Memory {
                peak: 1_000_000..,
                ..
            })
        ),
        "{result:?}"
    );
    let panicking = watched(|_| panic!("as planned"));
    let Err(Harm::Panic(message)) = execute(&panicking, b"").result else {
        panic!("it was not seen");
    };
    assert!(
        message.contains("readers.rs") && message.ends_with("as planned"),
        "{message}"
    );
    let slow = watched(|_| {
        std::thread::sleep(std::time::Duration::from_millis(1100));
        outcome()
    });
    assert!(matches!(execute(&slow, b"").result, Err(Harm::Slow(_))));
    assert!(execute(&watched(|_| outcome()), b"").result.is_ok());
}

#[test]
fn readers_do_no_harm() {
    the_watch_sees_harm();
    for target in targets() {
        for (i, seed) in target.seeds.iter().enumerate() {
            let executed = execute(&target, seed);
            let read = executed
                .result
                .unwrap_or_else(|harm| panic!("{} on seed {i}: {harm}", target.name));
            assert!(
                read.accepted,
                "{} refuses seed {i}: {}",
                target.name, read.message
            );
        }
        for (name, input) in kept(target.name) {
            check(&target, &input, &name);
        }
        let source: Source = target.source(1);
        let mut accepted = 0;
        for index in 0..EXECUTIONS {
            let input = source.input(index);
            assert_eq!(source.input(index), input, "an input is made again");
            check(&target, &input, &format!("input {index}"));
            accepted += u64::from(execute(&target, &input).result.is_ok_and(|o| o.accepted));
        }
        // Damage that is always refused at once, or never, would find nothing.
        let share = accepted as f64 / EXECUTIONS as f64;
        assert!(
            (0.005..0.95).contains(&share),
            "{} accepts {share}",
            target.name
        );
    }
}

#[test]
fn every_corpus_belongs_to_a_reader() {
    let names: Vec<&str> = targets().iter().map(|t| t.name).collect();
    for folder in std::fs::read_dir(corpus()).into_iter().flatten().flatten() {
        let name = folder.file_name().into_string().unwrap();
        assert!(names.contains(&name.as_str()), "{name}");
        assert!(!kept(&name).is_empty(), "{name}");
    }
}
