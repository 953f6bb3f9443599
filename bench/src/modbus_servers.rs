//! The Modbus TCP servers beside ours, each a process of its own with one thread: the smallest
//! that there can be, tokio-modbus and libmodbus.

use crate::daemon::{self, Running, start_program};
use crate::master::compiled;
use std::io::{self, ErrorKind};
use std::net::SocketAddr;
use tokio::io::AsyncReadExt as _;
use tokio::net::{TcpListener, TcpStream};

/// The package of the server of tokio-modbus.
const PEER: &str = "bench-tokio-modbus-server";

/// Where one of these servers is.
pub type Started = (Running, SocketAddr);

/// Starts the floor, which is this program.
pub fn start_floor() -> Result<Started, String> {
    let own = std::env::current_exe().map_err(|why| why.to_string())?;
    let (running, told) = start_program(&own, &["--modbus-floor"], "\n")?;
    Ok((running, address(&told)?))
}

/// Builds and starts tokio-modbus.
pub fn start_tokio_modbus() -> Result<Started, String> {
    let bench = env!("CARGO_MANIFEST_DIR");
    daemon::build_package(bench, PEER)?;
    let program = daemon::built(bench, PEER);
    let (running, told) = start_program(&program, &[], "\n")?;
    Ok((running, address(&told)?))
}

/// Starts libmodbus.
pub fn start_libmodbus() -> Result<Started, String> {
    let program = compiled("libmodbus_server").ok_or("libmodbus needs gcc and libmodbus-dev")?;
    let (running, told) = start_program(&program, &[], "\n")?;
    Ok((running, address(&told)?))
}

fn address(told: &str) -> Result<SocketAddr, String> {
    let address = told.trim().parse();
    address.map_err(|_| format!("that is no address: {told}"))
}

/// Is the floor until the process is ended. Its address is the first line of its output.
pub fn be_floor() -> Result<(), String> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_io()
        .build();
    let runtime = runtime.map_err(|why| why.to_string())?;
    let end = runtime.block_on(async {
        let listener = TcpListener::bind("127.0.0.1:0").await?;
        println!("{}", listener.local_addr()?);
        floor(&listener).await
    });
    end.map_err(|why| format!("floor: {why}"))
}

async fn floor(listener: &TcpListener) -> io::Result<()> {
    loop {
        let (stream, _) = listener.accept().await?;
        stream.set_nodelay(true)?;
        tokio::spawn(answer(stream));
    }
}

/// Answers every message with eight coils, without a look at what it asks for.
async fn answer(mut stream: TcpStream) -> io::Result<()> {
    let mut received = [0; 4096];
    let (mut filled, mut out) = (0, Vec::new());
    loop {
        match stream.read(&mut received[filled..]).await? {
            0 => return Ok(()),
            count => filled += count,
        }
        let mut done = 0;
        while let Some(&[t1, t0, _, _, l1, l0, unit]) = received[done..filled].first_chunk() {
            let length = 6 + usize::from(u16::from_be_bytes([l1, l0]));
            if filled - done < length {
                break;
            }
            out.extend_from_slice(&[t1, t0, 0, 0, 0, 4, unit, 1, 1, 0]);
            done += length;
        }
        received.copy_within(done..filled, 0);
        filled -= done;
        while !out.is_empty() {
            match stream.try_write(&out) {
                Ok(count) => _ = out.drain(..count),
                Err(why) if why.kind() == ErrorKind::WouldBlock => stream.writable().await?,
                Err(why) => return Err(why),
            }
        }
    }
}
