# Makes an image of Debian 12 with tachless. docs/several_hosts.md says what a container needs for the bus.
FROM debian:12
RUN apt-get update && apt-get install -y --no-install-recommends ca-certificates && rm -rf /var/lib/apt/lists/*
COPY . /opt/tachless
RUN /opt/tachless/tachless laws
WORKDIR /opt/tachless
ENTRYPOINT ["/opt/tachless/tachless"]
CMD ["--help"]
