<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE TS>
<TS version="2.1" language="zh_CN">
<context>
    <name>AllanPlot</name>
    <message>
        <source>random walk</source>
        <translation>随机游走</translation>
    </message>
    <message>
        <source>bias instability</source>
        <translation>零偏不稳定性</translation>
    </message>
    <message>
        <source>quantisation</source>
        <translation>量化噪声</translation>
    </message>
    <message>
        <source>averaging time, s</source>
        <translation>平均时间，s</translation>
    </message>
    <message>
        <source>Gyro</source>
        <translation>陀螺</translation>
    </message>
    <message>
        <source>Accel</source>
        <translation>加表</translation>
    </message>
    <message>
        <source>– – profile</source>
        <translation>– – 配置</translation>
    </message>
</context>
<context>
    <name>AllanView</name>
    <message>
        <source>Take these values…</source>
        <translation>采用这些值…</translation>
    </message>
    <message>
        <source>Copy table</source>
        <translation>复制表格</translation>
    </message>
    <message>
        <source>Back</source>
        <translation>返回</translation>
    </message>
    <message>
        <source>Not saved</source>
        <translation>未保存</translation>
    </message>
    <message>
        <source>Bias instability</source>
        <translation>零偏不稳定性</translation>
    </message>
    <message>
        <source>Random walk</source>
        <translation>随机游走</translation>
    </message>
    <message>
        <source>Profile</source>
        <translation>配置</translation>
    </message>
    <message>
        <source>Channel</source>
        <translation>通道</translation>
    </message>
    <message>
        <source>gyro {0}</source>
        <translation>陀螺 {0}</translation>
    </message>
    <message>
        <source>accel {0}</source>
        <translation>加表 {0}</translation>
    </message>
    <message>
        <source>Computing the Allan deviation</source>
        <translation>正在计算 Allan 偏差</translation>
    </message>
    <message>
        <source>–: no slope of −1/2, other noise hides the random walk. ≤: no flat minimum yet; needs a longer rest.</source>
        <translation>–：没有斜率为 −1/2 的部分，随机游走被其他噪声掩盖。≤：尚未出现平坦的最低点，需要更长的静止数据。</translation>
    </message>
    <message>
        <source>{0}: {1} at rest, samples {2} to {3}</source>
        <translation>{0}：静止 {1}，采样点 {2} 到 {3}</translation>
    </message>
    <message>
        <source>The log does not name an IMU profile.</source>
        <translation>记录中没有 IMU 配置的名称。</translation>
    </message>
    <message>
        <source>This rest determines none of the values; take a longer one.</source>
        <translation>这段静止数据不能确定任何数值，请选择更长的静止范围。</translation>
    </message>
    <message>
        <source>Stores them in the IMU profile as a new version</source>
        <translation>作为新版本保存到 IMU 配置</translation>
    </message>
    <message>
        <source>angle random walk</source>
        <translation>角度随机游走</translation>
    </message>
    <message>
        <source>velocity random walk</source>
        <translation>速度随机游走</translation>
    </message>
    <message>
        <source>gyro bias instability</source>
        <translation>陀螺零偏不稳定性</translation>
    </message>
    <message>
        <source>accelerometer bias instability</source>
        <translation>加表零偏不稳定性</translation>
    </message>
    <message>
        <source>Each is the largest of its three axes.</source>
        <translation>取三个轴中的最大值。</translation>
    </message>
    <message>
        <source>Not determined, so unchanged: {0}.</source>
        <translation>未能确定，保持不变：{0}。</translation>
    </message>
    <message>
        <source>Save as a new version of the IMU profile {0}?</source>
        <translation>保存为 IMU 配置 {0} 的新版本？</translation>
    </message>
    <message>
        <source>Cancel</source>
        <translation>取消</translation>
    </message>
    <message>
        <source>Save</source>
        <translation>保存</translation>
    </message>
    <message>
        <source>Saved: version {0} of the IMU profile {1}</source>
        <translation>已保存：IMU 配置 {1} 的版本 {0}</translation>
    </message>
    <message>
        <source>The next runs use it. Station, Profiles and products, restores earlier versions.</source>
        <translation>以后的标定将使用它。在“工位”页的“配置与产品”中可以恢复以前的版本。</translation>
    </message>
</context>
<context>
    <name>ChannelButton</name>
    <message>
        <source>Channels</source>
        <translation>通道</translation>
    </message>
    <message>
        <source>Shows or hides channels of the log</source>
        <translation>显示或隐藏记录的通道</translation>
    </message>
    <message>
        <source>Gyro {0}</source>
        <translation>陀螺 {0}</translation>
    </message>
    <message>
        <source>Accelerometer {0}</source>
        <translation>加表 {0}</translation>
    </message>
    <message>
        <source>Outer axis</source>
        <translation>外框</translation>
    </message>
    <message>
        <source>Inner axis</source>
        <translation>内框</translation>
    </message>
    <message>
        <source>Temperature</source>
        <translation>温度</translation>
    </message>
</context>
<context>
    <name>Comparison</name>
    <message>
        <source>run</source>
        <translation>在线</translation>
    </message>
    <message>
        <source>offline</source>
        <translation>离线</translation>
    </message>
    <message>
        <source>Run</source>
        <translation>在线标定</translation>
    </message>
    <message>
        <source>Offline</source>
        <translation>离线解算</translation>
    </message>
    <message>
        <source>Difference</source>
        <translation>比较</translation>
    </message>
    <message>
        <source>The run&apos;s parameters and those solved offline</source>
        <translation>在线标定与离线解算的参数</translation>
    </message>
    <message>
        <source>Parameters and their sigmas are shown here once a range is solved.</source>
        <translation>解算完成后，这里显示各参数及其标准差。</translation>
    </message>
    <message>
        <source>No result: this run did not reach its end</source>
        <translation>没有结果：这次标定没有做完</translation>
    </message>
    <message>
        <source>The log holds no result of a run</source>
        <translation>记录中没有在线标定结果</translation>
    </message>
    <message>
        <source>Not solved yet</source>
        <translation>尚未解算</translation>
    </message>
    <message>
        <source>offline, outdated</source>
        <translation>离线（已过期）</translation>
    </message>
    <message>
        <source>Outdated: the range or the stages have changed; solve again</source>
        <translation>已过期：范围或阶段已改变，请重新解算</translation>
    </message>
    <message>
        <source>Solved as far as the data allow; some stages are not</source>
        <translation>已按现有数据解算，并非每个阶段都能解算</translation>
    </message>
    <message>
        <source>Solved; the log names no limits to compare with</source>
        <translation>已解算；记录中没有可比较的限差</translation>
    </message>
    <message>
        <source>Partial: inside the limits, but not all stages of the product were solved</source>
        <translation>部分：满足限差，但没有解算产品的全部阶段</translation>
    </message>
    <message>
        <source>Inside every limit of the product</source>
        <translation>各项都在产品限差之内</translation>
    </message>
    <message>
        <source>Outside the limits: {0} of {1} checks</source>
        <translation>超出限差：{1} 项检查中有 {0} 项</translation>
    </message>
    <message>
        <source>Identical bit for bit</source>
        <translation>逐位完全一致</translation>
    </message>
    <message>
        <source>Largest difference {0} σ, {1}</source>
        <translation>最大差值 {0} σ，{1}</translation>
    </message>
    <message>
        <source>{0}; beyond 3 σ: {1}</source>
        <translation>{0}；超过 3 σ 的有 {1} 项</translation>
    </message>
    <message>
        <source>From samples {0} to {1}, part of the log.</source>
        <translation>只解算了记录的一部分：采样点 {0} 至 {1}。</translation>
    </message>
    <message>
        <source>, </source>
        <translation>、</translation>
    </message>
    <message>
        <source>Stages solved: {0}.</source>
        <translation>解算的阶段：{0}。</translation>
    </message>
    <message>
        <source>Not determined by these data: {0} of {1} parameters, marked below.</source>
        <translation>{1} 个参数中有 {0} 个无法由这些数据确定，已在下表标出。</translation>
    </message>
</context>
<context>
    <name>Exports</name>
    <message>
        <source>Compressed CSV (*.csv.gz)</source>
        <translation>压缩 CSV (*.csv.gz)</translation>
    </message>
    <message>
        <source>Export the log</source>
        <translation>导出记录</translation>
    </message>
    <message>
        <source>Export the range</source>
        <translation>导出范围</translation>
    </message>
    <message>
        <source>Parameters as CSV (*.csv)</source>
        <translation>参数表 CSV (*.csv)</translation>
    </message>
    <message>
        <source>Export the result</source>
        <translation>导出结果</translation>
    </message>
</context>
<context>
    <name>LogHead</name>
    <message>
        <source>Closer (+)</source>
        <translation>放大 (+)</translation>
    </message>
    <message>
        <source>Further away (−)</source>
        <translation>缩小 (−)</translation>
    </message>
    <message>
        <source>Bring the chosen range into view</source>
        <translation>显示所选范围</translation>
    </message>
    <message>
        <source>Bring the whole log into view (Home, or a double click)</source>
        <translation>显示整个记录（Home 键或双击）</translation>
    </message>
    <message>
        <source>Range</source>
        <translation>范围</translation>
    </message>
    <message>
        <source>All</source>
        <translation>全部</translation>
    </message>
    <message>
        <source>{0} samples, {1} Hz</source>
        <translation>{0} 个采样点，{1} Hz</translation>
    </message>
    <message>
        <source>gaps: {0}</source>
        <translation>中断 {0} 处</translation>
    </message>
    <message>
        <source>invalid samples: {0}</source>
        <translation>无效采样点 {0} 个</translation>
    </message>
    <message>
        <source>damaged rows: {0}</source>
        <translation>损坏的数据行 {0} 行</translation>
    </message>
</context>
<context>
    <name>LogPlot</name>
    <message>
        <source>outer</source>
        <translation>外框</translation>
    </message>
    <message>
        <source>inner</source>
        <translation>内框</translation>
    </message>
    <message>
        <source>Gyro, °/s</source>
        <translation>陀螺，°/s</translation>
    </message>
    <message>
        <source>Accelerometer, m/s²</source>
        <translation>加表，m/s²</translation>
    </message>
    <message>
        <source>Table, °</source>
        <translation>转台，°</translation>
    </message>
    <message>
        <source>Temperature, °C</source>
        <translation>温度，°C</translation>
    </message>
    <message>
        <source>The log&apos;s curves</source>
        <translation>记录曲线</translation>
    </message>
</context>
<context>
    <name>OfflinePage</name>
    <message>
        <source>This log cannot be opened</source>
        <translation>无法打开这个记录</translation>
    </message>
    <message>
        <source>This range cannot be solved</source>
        <translation>这个范围无法解算</translation>
    </message>
    <message>
        <source>step {0}: {1}</source>
        <translation>第 {0} 步：{1}</translation>
    </message>
    <message>
        <source>step {0}</source>
        <translation>第 {0} 步</translation>
    </message>
    <message>
        <source>Sample {0}</source>
        <translation>采样点 {0}</translation>
    </message>
    <message>
        <source>Another log can be opened when this job has ended or is cancelled.</source>
        <translation>等当前任务完成或取消后，才能打开另一个记录。</translation>
    </message>
    <message>
        <source>The range or the stages have changed: solve again first</source>
        <translation>范围或阶段已改变：请先重新解算</translation>
    </message>
    <message>
        <source>Open a log first</source>
        <translation>请先打开一个记录</translation>
    </message>
    <message>
        <source>The range holds no stage; widen it</source>
        <translation>所选范围内没有任何阶段，请扩大范围</translation>
    </message>
    <message>
        <source>Tick a stage to solve</source>
        <translation>请勾选要解算的阶段</translation>
    </message>
    <message>
        <source>Of the chosen range, at rest: gives random walk and bias instability</source>
        <translation>对所选的静止范围计算，得出随机游走和零偏不稳定性</translation>
    </message>
    <message>
        <source>Export range…</source>
        <translation>导出范围…</translation>
    </message>
    <message>
        <source>Solve the log first</source>
        <translation>请先解算</translation>
    </message>
    <message>
        <source>A stored log, drawn and solved again</source>
        <translation>查看数据记录并离线解算</translation>
    </message>
    <message>
        <source>Open a log…</source>
        <translation>打开记录…</translation>
    </message>
    <message>
        <source>Reading the log</source>
        <translation>正在读取记录</translation>
    </message>
    <message>
        <source>Start offline solve</source>
        <translation>开始离线解算</translation>
    </message>
    <message>
        <source>Export result…</source>
        <translation>导出结果…</translation>
    </message>
    <message>
        <source>Allan deviation</source>
        <translation>Allan 偏差</translation>
    </message>
    <message>
        <source>No rest has been found</source>
        <translation>没有找到静止数据</translation>
    </message>
    <message>
        <source>This range has no Allan deviation</source>
        <translation>此范围不能计算 Allan 偏差</translation>
    </message>
    <message>
        <source>Export log…</source>
        <translation>导出记录…</translation>
    </message>
    <message>
        <source>Only the chosen samples; “Set to…” returns to the whole log</source>
        <translation>仅所选采样点；用“设为…”可恢复整个记录</translation>
    </message>
    <message>
        <source>Open a raw log (.h5) or a CSV with its TOML beside it, or drop the file here. Choose a range; the solver of the run solves it again, and both results are compared.</source>
        <translation>打开数据记录（.h5）或带同名 TOML 的 CSV，也可将文件拖到此处。选择区间后，用与运行时相同的解算程序重新解算，并比较两个结果。</translation>
    </message>
</context>
<context>
    <name>RangeBar</name>
    <message>
        <source>First sample</source>
        <translation>起始采样点</translation>
    </message>
    <message>
        <source>Last sample</source>
        <translation>结束采样点</translation>
    </message>
    <message>
        <source>Set to…</source>
        <translation>设为…</translation>
    </message>
    <message>
        <source>The whole log, a stage, or the longest rest</source>
        <translation>整个记录、某个阶段或最长的静止</translation>
    </message>
    <message>
        <source>Whole log</source>
        <translation>整个记录</translation>
    </message>
    <message>
        <source>Longest rest</source>
        <translation>最长的静止</translation>
    </message>
    <message>
        <source>The first sample cannot be after the last: set to {0}.</source>
        <translation>起始采样点不能在结束采样点之后：已设为 {0}。</translation>
    </message>
    <message>
        <source>The last sample cannot be before the first: set to {0}.</source>
        <translation>结束采样点不能在起始采样点之前：已设为 {0}。</translation>
    </message>
    <message>
        <source>{0} is not in this log; it holds samples {1} to {2}.</source>
        <translation>{0} 不在此记录内；记录含采样点 {1} 至 {2}。</translation>
    </message>
</context>
<context>
    <name>SourceBar</name>
    <message>
        <source>Open a log</source>
        <translation>打开记录</translation>
    </message>
    <message>
        <source>Logs (*.h5 *.csv *.csv.gz)</source>
        <translation>数据记录 (*.h5 *.csv *.csv.gz)</translation>
    </message>
    <message>
        <source>All files (*)</source>
        <translation>所有文件 (*)</translation>
    </message>
    <message>
        <source>Log</source>
        <translation>记录</translation>
    </message>
    <message>
        <source>Path of a raw log (.h5) or of a CSV with its TOML beside it</source>
        <translation>数据记录（.h5）的路径，或旁边有 TOML 的 CSV 的路径</translation>
    </message>
    <message>
        <source>Open…</source>
        <translation>打开…</translation>
    </message>
    <message>
        <source>Recent</source>
        <translation>最近打开</translation>
    </message>
    <message>
        <source>Latest runs</source>
        <translation>最近的标定</translation>
    </message>
    <message>
        <source>No log has been opened here yet</source>
        <translation>这里还没有打开过记录</translation>
    </message>
</context>
<context>
    <name>StageChoice</name>
    <message>
        <source>The range holds no sample of this stage</source>
        <translation>所选范围内没有这个阶段的采样点</translation>
    </message>
</context>
</TS>
