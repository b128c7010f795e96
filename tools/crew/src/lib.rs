//! Work shared by threads, with results in the order of the work: who does what has no influence on them.

use std::sync::{Mutex, PoisonError};

/// Does jobs `0..count` on `threads` threads. Each thread makes a worker of its own; `done` hears after each job how many
/// are done.
///
/// # Errors
/// The first error of a worker's making, or that of the job of the lowest number.
pub fn in_order<W, T: Send, E: Send>(
    count: usize,
    threads: usize,
    hire: impl Fn() -> Result<W, E> + Sync,
    job: impl Fn(&mut W, usize) -> Result<T, E> + Sync,
    done: &mut (dyn FnMut(usize) + Send),
) -> Result<Vec<T>, E> {
    let mut results: Vec<Option<Result<T, E>>> = (0..count).map(|_| None).collect();
    let work = Mutex::new((results.iter_mut().enumerate(), 0, done));
    let failed = Mutex::new(None);
    std::thread::scope(|scope| {
        for _ in 0..threads.clamp(1, count.max(1)) {
            scope.spawn(|| {
                let mut worker = match hire() {
                    Ok(worker) => worker,
                    Err(error) => {
                        failed.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
                        return;
                    }
                };
                loop {
                    let next = work.lock().unwrap_or_else(PoisonError::into_inner).0.next();
                    let Some((number, result)) = next else { break };
                    *result = Some(job(&mut worker, number));
                    let mut work = work.lock().unwrap_or_else(PoisonError::into_inner);
                    work.1 += 1;
                    let finished = work.1;
                    (work.2)(finished);
                }
            });
        }
    });
    if let Some(error) = failed.into_inner().unwrap_or_else(PoisonError::into_inner) {
        return Err(error);
    }
    results.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_come_in_the_order_of_the_work_for_any_number_of_threads() {
        for threads in [1, 2, 7] {
            let mut heard = 0;
            let done = &mut |finished| heard = finished;
            let squares: Result<Vec<usize>, ()> = in_order(50, threads, || Ok(()), |(), n| Ok(n * n), done);
            assert_eq!(squares, Ok((0..50).map(|n| n * n).collect()));
            assert_eq!(heard, 50);
        }
    }

    #[test]
    fn the_error_of_the_first_job_that_fails_is_told() {
        let job = |(): &mut (), n: usize| if n < 3 { Ok(n) } else { Err(n) };
        assert_eq!(in_order(9, 3, || Ok(()), job, &mut |_| ()), Err(3));
        assert_eq!(in_order(9, 3, || Err::<(), _>(42), job, &mut |_| ()), Err(42));
    }
}
