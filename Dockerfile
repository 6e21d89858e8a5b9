# docker build -t compact .
# docker run --rm --user "$(id -u)" -v "$PWD:/work" compact                           the published machine, minutes
# docker run --rm --user "$(id -u)" -v "$PWD:/work" compact run mine/scene.toml       a scene of the present folder
FROM python:3.13-slim AS build
WORKDIR /source
COPY pyproject.toml constraints.txt README.md LICENSE ./
COPY compact compact
RUN pip wheel --no-cache-dir --wheel-dir /wheels --constraint constraints.txt ".[cluster]"

FROM python:3.13-slim
RUN --mount=type=bind,from=build,source=/wheels,target=/wheels pip install --no-cache-dir /wheels/*.whl
RUN useradd --create-home --uid 1000 compact && install --directory --owner=compact /work
USER compact
WORKDIR /work
ENV MPLBACKEND=Agg MPLCONFIGDIR=/tmp/matplotlib NUMBA_CACHE_DIR=/tmp/numba
ENTRYPOINT ["compact"]
CMD ["run", "loveikin-2015-engines"]
