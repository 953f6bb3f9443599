//! The Modbus TCP server of tokio-modbus, on one thread, with a service that does nothing. Serves
//! until the process is ended; its address is the first line of its output.

use std::future::{Ready, ready};
use std::io;
use std::net::SocketAddr;
use tokio::net::{TcpListener, TcpStream};
use tokio_modbus::server::Service;
use tokio_modbus::server::tcp::Server;
use tokio_modbus::{ExceptionCode, Request, Response};

/// Coils that are off.
#[derive(Clone, Copy, Debug)]
struct Off;

impl Service for Off {
    type Request = Request<'static>;
    type Response = Response;
    type Exception = ExceptionCode;
    type Future = Ready<Result<Response, ExceptionCode>>;

    fn call(&self, request: Request<'static>) -> Self::Future {
        ready(match request {
            Request::ReadCoils(_, count) => {
                Ok(Response::ReadCoils(vec![false; usize::from(count)]))
            }
            _ => Err(ExceptionCode::IllegalFunction),
        })
    }
}

async fn serve() -> io::Result<()> {
    let listener = TcpListener::bind("127.0.0.1:0").await?;
    println!("{}", listener.local_addr()?);
    let connected = |stream: TcpStream, _: SocketAddr| async move {
        stream.set_nodelay(true)?;
        Ok(Some((Off, stream)))
    };
    Server::new(listener).serve(&connected, |_| ()).await
}

fn main() -> io::Result<()> {
    let mut runtime = tokio::runtime::Builder::new_current_thread();
    runtime.enable_io().build()?.block_on(serve())
}
