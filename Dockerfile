# The virtual rig, the fits and the reports in a container; see docs/howto/install.md.
#
#     docker build -t eimi-lab .
#     docker run --rm --user "$(id -u):$(id -g)" -v "$PWD:/data" eimi-lab demo --quick

# The wheel is built in a first image, which has git because the version is counted from the tags.
FROM python:3.11-slim AS build
RUN apt-get update -qq && apt-get install -y -qq --no-install-recommends git
COPY . /source
RUN git config --global --add safe.directory /source && pip wheel --quiet --no-deps --wheel-dir /wheels /source

FROM python:3.11-slim
COPY --from=build /wheels /wheels
RUN pip install --quiet --no-cache-dir /wheels/*.whl && rm -r /wheels
# Any user may run it: matplotlib needs a folder that this user can write.
ENV MPLCONFIGDIR=/tmp/matplotlib PYTHONUNBUFFERED=1
WORKDIR /data
ENTRYPOINT ["eimi"]
CMD ["demo", "--quick"]
