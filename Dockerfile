# Palpate with its locked packages. The steps are the README's, as they work on bare Debian 12.
#   docker build --tag palpate .
#   docker run --rm --volume "$PWD/results:/palpate/results" palpate make demo
FROM debian:12-slim
RUN apt-get update \
 && apt-get install --yes --no-install-recommends ca-certificates git make python3 python3-venv \
 && rm -rf /var/lib/apt/lists/*
WORKDIR /palpate
COPY Makefile pyproject.toml README.md LICENSE ./
COPY envs envs
COPY palpate palpate
RUN apt-get update && make PYTHON=python3 env && rm -rf /var/lib/apt/lists/* /root/.cache
COPY . .
ENV PATH=/palpate/.venv/bin:$PATH
CMD ["make", "smoke"]
